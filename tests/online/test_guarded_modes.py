# SPDX-License-Identifier: BSD-3-Clause
"""The guard in front of the real modes: without effect on samples in order, and with damaged stamps close to that."""

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
import pytest
from damaged_streams import MS, S, beginning, jittered, moved, moved_from

import coclo_vio as cv
from coclo_vio.runs.modes.registry import mode_of, modes
from coclo_vio.values.measurements import ALL_SENSORS, IMAGE_SENSORS

Stream = Sequence[cv.Measurement]
FAULT_NS = 4 * S  # after the start: the robot walks
LENGTH_NS = 6 * S


def estimator(mode: str, recording: cv.Recording) -> cv.GuardedEstimator:
    return cv.make_estimator(mode, robot=recording.robot, calibration=recording.calibration)


def bare(mode: str, recording: cv.Recording) -> cv.Estimator:
    """The same without the guard."""
    return cv.make_estimator(mode, robot=recording.robot, calibration=recording.calibration)._make()


def outputs_of(odometry: cv.Estimator, measurements: Stream) -> list[cv.Output]:
    outputs = [output for measurement in measurements for output in odometry.push(measurement)]
    return [*outputs, *odometry.finish()]


def states(outputs: Sequence[cv.Output], name: str) -> list[cv.StateEstimate]:
    return [output.state for output in outputs if isinstance(output, cv.Estimate) and output.name == name]


def events(outputs: Sequence[cv.Output]) -> list[cv.Event]:
    return [output for output in outputs if isinstance(output, cv.Event)]


def part(measurements: Stream, length_ns: int) -> tuple[cv.Measurement, ...]:
    """The beginning."""
    return tuple(each for each in measurements if each.stamp_ns - measurements[0].stamp_ns < length_ns)


def runnable(mode: str) -> bool:
    """Whether the bundled recording is enough for it."""
    return cv.Need.BODY_TWIST not in mode_of(mode).needs


@pytest.mark.long
@pytest.mark.parametrize("mode", [name for name in modes() if runnable(name)])
def test_on_samples_in_order_the_guard_changes_nothing(
    mode: str, sample: cv.Recording, walk: Stream, walk_with_images: Stream
) -> None:
    has_cameras = mode_of(mode).has_cameras
    whole = walk_with_images if has_cameras else walk
    measurements = part(whole, (2 if has_cameras else 3) * S)
    alone = outputs_of(bare(mode, sample), measurements)
    guarded = outputs_of(estimator(mode, sample), measurements)
    guarded = [output for output in guarded if not isinstance(output, cv.Status)]
    assert [type(output) for output in guarded] == [type(output) for output in alone]
    for one, other in zip(guarded, alone, strict=True):
        if isinstance(one, cv.Estimate) and isinstance(other, cv.Estimate):
            assert (one.name, one.state.stamp_ns) == (other.name, other.state.stamp_ns)
            np.testing.assert_allclose(one.state.nav.T_world_body, other.state.nav.T_world_body, rtol=0, atol=1e-9)
            np.testing.assert_allclose(one.state.covariance, other.state.covariance, rtol=1e-9, atol=1e-12)
    assert any(isinstance(output, cv.Estimate) for output in alone)


def one_joint_sample_an_hour_ahead(walk: Stream) -> list[cv.Measurement]:
    at = walk[0].stamp_ns + FAULT_NS
    index = next(i for i, each in enumerate(walk) if each.stamp_ns >= at and isinstance(each, cv.JointSample))
    return [*walk[:index], moved(walk[index], 3600 * S), *walk[index + 1 :]]


def stepped(step_s: float, *kinds: type) -> Callable[[Stream], list[cv.Measurement]]:
    return lambda walk: moved_from(walk, walk[0].stamp_ns + FAULT_NS, round(step_s * S), kinds or (object,))


def with_jitter(walk: Stream) -> list[cv.Measurement]:
    rng = np.random.default_rng(6)
    kinds = cv.ImuSample | cv.JointSample
    return jittered(walk, lambda each: rng.uniform(0, 30 * MS) if isinstance(each, kinds) else 0.0)[0]


def repeated(walk: Stream) -> list[cv.Measurement]:
    return [each for measurement in walk for each in (measurement, measurement)]


FAULTS: dict[str, tuple[Callable[[Stream], list[cv.Measurement]], str | None, int]] = {
    "one joint sample an hour ahead": (one_joint_sample_an_hour_ahead, "of joints refused (future)", 1),
    "all clocks 10 s back": (stepped(-10.0), "the clock of all streams stepped back by 10 s", 0),
    "all clocks 0.3 s back": (stepped(-0.3), "the clock of all streams stepped back by 0.3 s", 0),
    "all clocks an hour ahead": (stepped(3600.0), "the clock of all streams stepped forward by 3600 s", 0),
    "IMU's clock an hour ahead": (stepped(3600.0, cv.ImuSample), "the clock of imu stepped forward", 0),
    "IMU's clock 10 s back": (stepped(-10.0, cv.ImuSample), "the clock of imu stepped back", 0),
    "joints' clock an hour ahead": (stepped(3600.0, cv.JointSample), "the clock of joints stepped forward", 0),
    "jitter of 30 ms": (with_jitter, None, 0),
    "everything twice": (repeated, "refused (repeated)", 0),
}


@cache
def clean_end(recording: cv.Recording) -> cv.StateEstimate:
    walk = beginning(recording, ALL_SENSORS - IMAGE_SENSORS, LENGTH_NS / S)
    return states(outputs_of(estimator("coclo", recording), walk), "coclo")[-1]


@pytest.mark.long
@pytest.mark.parametrize("fault", FAULTS)
def test_leg_odometry_survives_it_and_an_event_names_it(fault: str, sample: cv.Recording, walk: Stream) -> None:
    damage, named, lost = FAULTS[fault]
    walk = part(walk, LENGTH_NS)
    odometry = estimator("coclo", sample)
    outputs = outputs_of(odometry, damage(walk))
    by_legs, end = states(outputs, "coclo"), clean_end(sample)
    apart = np.linalg.norm(by_legs[-1].nav.T_world_body[:3, 3] - end.nav.T_world_body[:3, 3])
    assert apart < 0.002
    (joints,) = [stream for stream in odometry.status.streams if stream.name == "joints"]
    kept = sum(isinstance(each, cv.JointSample) for each in walk) - lost
    assert joints.used == kept
    assert joints.arrived == joints.used + joints.held + sum(joints.refused.values())
    found = [event.detail for event in events(outputs)]
    assert any(named in detail for detail in found) if named else not found
    poses = np.stack([state.nav.T_world_body[:3, 3] for state in by_legs])
    assert np.linalg.norm(np.diff(poses, axis=0), axis=1).max() < 0.02, "the pose is continuous"


def test_after_a_step_the_covariance_allows_for_the_unknown_time(sample: cv.Recording, walk: Stream) -> None:
    outputs = outputs_of(estimator("coclo", sample), stepped(3600.0)(part(walk, LENGTH_NS)))
    by_legs = states(outputs, "coclo")
    sigma_m = [np.sqrt(state.covariance[3:6, 3:6].trace()) for state in by_legs]
    at = next(i for i, state in enumerate(by_legs) if state.stamp_ns >= walk[0].stamp_ns + 3600 * S)
    speed_mps = np.linalg.norm(by_legs[at - 1].nav.velocity_world)
    assert sigma_m[at] ** 2 - sigma_m[at - 1] ** 2 > (0.1 * speed_mps) ** 2


@pytest.mark.parametrize("mode", ["naive", "inekf"])
def test_where_a_filter_does_not_allow_for_it_the_guard_does(mode: str, sample: cv.Recording, walk: Stream) -> None:
    by_legs = states(outputs_of(estimator(mode, sample), stepped(3600.0)(part(walk, LENGTH_NS))), mode)
    sigma_m = [np.sqrt(state.covariance[3:6, 3:6].trace()) for state in by_legs]
    at = next(i for i, state in enumerate(by_legs) if state.stamp_ns >= walk[0].stamp_ns + 3600 * S)
    assert sigma_m[at] > sigma_m[at - 1] + 0.001


@pytest.mark.long
@pytest.mark.parametrize("mode", ["combined", "vins"])
def test_vision_goes_on_over_a_step(mode: str, sample: cv.Recording, walk_with_images: Stream) -> None:
    name = "combined_vins" if mode == "combined" else "vins"
    walk = part(walk_with_images, 4 * S)
    at = walk[0].stamp_ns + 3 * S
    clean = states(outputs_of(estimator(mode, sample), walk), name)
    outputs = outputs_of(estimator(mode, sample), moved_from(walk, at, -10 * S))
    found = states(outputs, name)
    assert len(found) == len(clean)
    assert found[-1].stamp_ns == clean[-1].stamp_ns - 10 * S
    apart = np.linalg.norm(found[-1].nav.T_world_body[:3, 3] - clean[-1].nav.T_world_body[:3, 3])
    assert apart < 0.03
    assert [event.kind for event in events(outputs)].count("clock_step") == 1
