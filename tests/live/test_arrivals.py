# SPDX-License-Identifier: BSD-3-Clause
"""Messages that overtake each other, impossible stamps and clocks that step, on the wire: nothing is lost."""

from dataclasses import replace

import numpy as np
import pytest
from played_source import messages_of, run_played, stamped_later

from coclo_vio.runs.run_folder import read_estimates
from coclo_vio.values.units import NS_PER_S

_TOPICS = ("/joint_states", "/imu", "/camera/imu")


@pytest.fixture(scope="module")
def messages(short_recording):
    return [m for m in messages_of(short_recording) if m.topic in _TOPICS or m.topic == "/tf_static"]


@pytest.fixture(scope="module")
def clean(messages, tmp_path_factory):
    folder = tmp_path_factory.mktemp("clean")
    run_played(messages, folder)
    return read_estimates(folder, "coclo").trajectory


def _delayed(messages, longest_s, seed):
    """The messages as they come where each is under way for a random time."""
    random = np.random.default_rng(seed)
    delays = [round(random.uniform(0.0, longest_s.get(m.topic, 0.0)) * NS_PER_S) for m in messages]
    late = [replace(m, monotonic_ns=m.monotonic_ns + delay) for m, delay in zip(messages, delays, strict=True)]
    return sorted(late, key=lambda message: message.monotonic_ns)


@pytest.mark.long
@pytest.mark.parametrize("has_arrivals", [True, False])
def test_messages_that_overtake_each_other_are_put_in_order(messages, clean, tmp_path, has_arrivals):
    delayed = _delayed(messages, {"/joint_states": 0.025, "/imu": 0.025, "/camera/imu": 0.004}, seed=3)
    order = [m.arrived_ns for m in delayed if m.topic == "/joint_states"]
    assert np.mean(np.diff(order) < 0) > 0.1, "a tenth of them comes after a later one"
    record, _ = run_played(delayed if has_arrivals else [replace(m, monotonic_ns=None) for m in delayed], tmp_path)
    counts = record.estimators["coclo"].counts
    assert not [name for name in counts if "late" in name or "repeated" in name], counts
    found = read_estimates(tmp_path, "coclo").trajectory
    np.testing.assert_array_equal(found.stamps_ns, clean.stamps_ns)
    np.testing.assert_allclose(found.positions, clean.positions, atol=1e-9)


@pytest.mark.long
def test_velocities_are_estimated_of_joints_in_order(messages, tmp_path):
    settings = ["dataset.corrections.joints.velocity=from_position"]
    last_ns = messages[0].arrived_ns + 4 * NS_PER_S
    some = [m for m in messages if m.arrived_ns < last_ns]
    positions = []
    for name, given in (("late", _delayed(some, {"/joint_states": 0.025}, seed=4)), ("clean", some)):
        run_played(given, tmp_path / name, settings=settings)
        positions.append(read_estimates(tmp_path / name, "coclo").trajectory.positions)
    np.testing.assert_allclose(*positions, atol=1e-9)


@pytest.mark.long
def test_stamps_of_the_future_are_refused_and_nothing_else_is(messages, clean, tmp_path):
    numbers = [i for i, m in enumerate(messages) if m.topic == "/joint_states"][200:500:100]
    wrong = [stamped_later(m, 3600 * NS_PER_S) if i in numbers else m for i, m in enumerate(messages)]
    record, counted = run_played(wrong, tmp_path)
    run = record.estimators["coclo"]
    assert run.counts["joints_future"] == len(numbers) == 3
    assert counted.topics["/joint_states"].refused == {}, "the converter passes them on to the guard"
    details = [event.detail for event in run.events if event.kind == "stamp_refused"]
    assert len(details) == 3
    assert all("joints" in detail and "online.future_s" in detail for detail in details)
    found = read_estimates(tmp_path, "coclo").trajectory
    assert len(found) == len(clean) - len(numbers)
    np.testing.assert_allclose(found.positions[-1], clean.positions[-1], atol=2e-3)


@pytest.mark.long
@pytest.mark.parametrize("step_s", [-600, 600])
def test_a_clock_that_steps_on_the_wire_is_followed(messages, clean, tmp_path, step_s):
    at_ns = messages[-1].monotonic_ns - 2 * NS_PER_S
    stepped = [stamped_later(m, step_s * NS_PER_S) if m.monotonic_ns > at_ns else m for m in messages]
    record, counted = run_played(stepped, tmp_path)
    run = record.estimators["coclo"]
    steps = [event.detail for event in run.events if event.kind == "clock_step"]
    assert len(steps) == 1
    assert f"stepped {'back' if step_s < 0 else 'forward'} by 600 s" in steps[0]
    assert "0 s of unknown motion" in steps[0], "the times of arrival say how long it took"
    assert not [name for name in run.counts if name.endswith(("_future", "_past", "_late", "_repeated"))]
    assert run.measurements == sum(topic.received for name, topic in counted.topics.items() if name in _TOPICS)
    assert run.estimates == len(clean)
    found = read_estimates(tmp_path, "coclo")
    np.testing.assert_array_equal(found.trajectory.stamps_ns, clean.stamps_ns, "files keep the first clock")
    np.testing.assert_allclose(found.trajectory.positions[-1], clean.positions[-1], atol=2e-3)


@pytest.mark.long
@pytest.mark.parametrize("stall_s", [1.2, 2.5])
def test_what_a_network_held_back_is_used_as_if_it_had_not(messages, clean, tmp_path, stall_s):
    """For a while nothing comes, then everything at once, and then as before."""
    begin_ns = messages[0].monotonic_ns + 2 * NS_PER_S
    end_ns = begin_ns + round(stall_s * NS_PER_S)
    held = [replace(m, monotonic_ns=end_ns) if begin_ns < m.monotonic_ns < end_ns else m for m in messages]
    record, _ = run_played(held, tmp_path)
    run = record.estimators["coclo"]
    assert [event.kind for event in run.events if event.kind in ("clock_step", "stamp_refused")] == []
    assert run.estimates == len(clean)
    np.testing.assert_allclose(read_estimates(tmp_path, "coclo").trajectory.positions, clean.positions, atol=1e-9)
