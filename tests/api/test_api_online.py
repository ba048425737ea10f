# SPDX-License-Identifier: BSD-3-Clause
"""An estimator that is made online gives what a run over the recording gives."""

from pathlib import Path

import numpy as np
import pytest

import coclo_vio as cv

POSE_PRECISION = 1e-9  # of what a run folder keeps, m and quaternion


def estimates_online(recording: cv.Recording, estimator: cv.Estimator) -> dict[str, list[cv.StateEstimate]]:
    """The estimates by trajectory, of all measurements of the recording whatever the mode reads."""
    states: dict[str, list[cv.StateEstimate]] = {}

    def keep(output: cv.Output) -> None:
        if isinstance(output, cv.Estimate):
            states.setdefault(output.name, []).append(output.state)

    for measurement in recording.measurements():
        for output in estimator.push(measurement):
            keep(output)
    for output in estimator.finish():
        keep(output)
    return states


@pytest.mark.long
@pytest.mark.parametrize("mode", ["coclo", "combined"])
def test_online_estimates_equal_those_of_a_run(mode: str, go1_walk: Path, combined_run: cv.Run) -> None:
    recording = cv.open(go1_walk, robot="go1")
    run = combined_run if mode == "combined" else cv.run(recording, mode)
    estimator = cv.make_estimator(mode, robot="go1", calibration=recording.calibration)
    online = estimates_online(recording, estimator)
    assert tuple(online) == run.names
    for name, states in online.items():
        recorded = run.trajectories[name]
        assert [state.stamp_ns for state in states] == recorded.stamps_ns.tolist()
        poses = np.stack([state.nav.T_world_body for state in states])
        np.testing.assert_allclose(poses, recorded.T_world_body, rtol=0, atol=POSE_PRECISION)
        velocity = np.stack([state.nav.velocity_world for state in states])
        np.testing.assert_allclose(velocity, recorded.velocity_world, rtol=1e-8, atol=1e-9)
    counts = {name: count for name, count in estimator.counts.items() if count}
    assert counts == {name: count for name, count in run.record.estimators[run.names[0]].counts.items() if count}


def test_leg_odometry_needs_no_calibration(leg_log: Path, coclo_run: cv.Run) -> None:
    recording = cv.open(leg_log)
    states = estimates_online(recording, cv.make_estimator("coclo", robot=recording.robot))
    recorded = coclo_run.trajectories["coclo"]
    poses = np.stack([state.nav.T_world_body for state in states["coclo"]])
    np.testing.assert_allclose(poses, recorded.T_world_body, rtol=0, atol=POSE_PRECISION)


def test_the_filter_of_the_robots_description_is_used(leg_log: Path) -> None:
    """As a run does: the parameters in the robot's YAML, unless a configuration is given."""
    described = cv.load_robot("daisy").model_copy(update={"filter": {"profile": "paper"}})
    recording = cv.open(leg_log)
    of_the_robot = estimates_online(recording, cv.make_estimator("coclo", robot=described))["coclo"]
    of_the_mode = estimates_online(recording, cv.make_estimator("coclo_paper", robot="daisy"))["coclo_paper"]
    np.testing.assert_array_equal(of_the_robot[-1].nav.T_world_body, of_the_mode[-1].nav.T_world_body)


def test_stereo_alone_takes_the_cameras_calibration(go1_walk: Path) -> None:
    recording = cv.open(go1_walk, robot="go1")
    stereo = recording.calibration.stereo
    assert stereo is not None
    estimator = cv.make_estimator("stereo", calibration=stereo, pictures_every=10)
    frames = list(recording.measurements(frozenset({cv.StereoFrame})))[:21]
    outputs = [output for frame in frames for output in estimator.push(frame)]
    outputs += estimator.finish()
    assert sum(isinstance(output, cv.Picture) for output in outputs) == 3
    assert [output.name for output in outputs if isinstance(output, cv.Estimate)][-1] == "stereo"
