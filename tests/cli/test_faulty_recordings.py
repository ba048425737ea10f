# SPDX-License-Identifier: BSD-3-Clause
"""Faulty bags, as a user meets them: one sentence and exit status 1, and --allow-partial reads what can be read."""

import dataclasses
from itertools import takewhile
from pathlib import Path

import pytest
from console import Coclo

from coclo_vio.datasets.dataset import open_dataset
from coclo_vio.datasets.rosbag.writing.messages import BagMessages
from coclo_vio.datasets.rosbag.writing.new_bag import new_bag
from coclo_vio.robot.description import load_robot
from coclo_vio.values.measurements import ImuSample, JointSample, Measurement

DAISY = load_robot("daisy")
WRONG = ["leg3_ellbow" if name == "leg3_elbow" else name for name in DAISY.joint_names]
LENGTH_NS = 2_500_000_000


@pytest.fixture(scope="module")
def walk(short_recording: Path) -> list[ImuSample | JointSample]:
    """The first 2.5 s of the short recording, without its cameras."""
    stream = open_dataset(short_recording, DAISY).measurements(frozenset({ImuSample, JointSample}))
    first = next(stream)
    beginning = takewhile(lambda sample: sample.stamp_ns < first.stamp_ns + LENGTH_NS, stream)
    return [sample for sample in beginning if isinstance(sample, ImuSample | JointSample)]


def write(path: Path, samples: list[Measurement], names: list[str] | tuple[str, ...] = DAISY.joint_names) -> Path:
    """Samples by the order in which they are given; that is when they were received."""
    received_ns = sorted(sample.stamp_ns for sample in samples)
    with new_bag(path) as bag:
        make = BagMessages(bag)
        for received, sample in zip(received_ns, samples, strict=True):
            if isinstance(sample, JointSample):
                message = make.joints("", names, sample, with_velocity=True, with_effort=True)
                bag.write("/joint_states", received, message)
            elif isinstance(sample, ImuSample):
                bag.write("/imu", received, make.imu("imu_link", sample, 0.0, 0.0))
    return path


def cut(path: Path) -> Path:
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 8 // 10])
    return path


def swapped(samples: list[Measurement]) -> list[Measurement]:
    """Two joint samples of the middle with each other's stamps."""
    result = list(samples)
    one, other = [i for i, sample in enumerate(samples) if isinstance(sample, JointSample)][100:102]
    for here, there in ((one, other), (other, one)):
        result[here] = dataclasses.replace(samples[here], stamp_ns=samples[there].stamp_ns)
    return result


def faulty_bag(fault: str, path: Path, walk: list[Measurement]) -> Path:
    match fault:
        case "cut off":
            return cut(write(path, walk))
        case "no joints":
            return write(path, [sample for sample in walk if isinstance(sample, ImuSample)])
        case "wrong name":
            return write(path, walk, WRONG)
        case _:
            return write(path, swapped(walk))


@pytest.mark.long
@pytest.mark.parametrize(
    ("fault", "message", "has_usable_part"),
    [
        ("cut off", "the bag is damaged or cut off", True),
        ("no joints", "has no joint, so there is no leg odometry", False),
        ("wrong name", "the joints of daisy except leg3_elbow; its other joints are leg3_ellbow", True),
        ("swapped stamps", "on /joint_states: its stamp", True),
    ],
)
@pytest.mark.parametrize("name", ["walk.bag", "walk.mcap", "walk.db3"])
def test_a_faulty_bag_is_one_sentence_and_is_read_in_part_on_request(
    coclo: Coclo, tmp_path: Path, walk: list[Measurement], name: str, fault: str, message: str, has_usable_part: bool
) -> None:
    faulty_bag(fault, tmp_path / name, walk)
    answer = coclo("run", name, "-m", "naive")
    errors = [line for line in answer.err.splitlines() if line.startswith("coclo-vio: ")]
    assert answer.status == 1
    assert len(errors) == 1
    assert message in errors[0]
    assert name in errors[0]
    assert "Traceback" not in answer.err
    assert coclo("run", name, "-m", "naive", "--allow-partial", "-o", "part").status == (0 if has_usable_part else 1)


@pytest.mark.parametrize(("fault", "message"), [("no joints", "there are no joints"), ("wrong name", "leg3_ellbow")])
def test_with_the_robot_named_the_sentence_is_about_the_bag(
    coclo: Coclo, tmp_path: Path, walk: list[Measurement], fault: str, message: str
) -> None:
    faulty_bag(fault, tmp_path / "walk.mcap", walk)
    answer = coclo("run", "walk.mcap", "--robot", "daisy")
    assert answer.status == 1
    assert message in answer.err
    assert "stopped early" not in answer.err


def test_joints_of_no_known_robot_are_listed(coclo: Coclo, tmp_path: Path, walk: list[Measurement]) -> None:
    write(tmp_path / "walk.mcap", walk, [f"q{number}" for number in range(len(DAISY.joint_names))])
    answer = coclo("run", "walk.mcap")
    assert answer.status == 2
    assert "which robot is it?" in answer.err
    assert "the joints of walk.mcap are q0, q1" in answer.err
