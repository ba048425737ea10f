# SPDX-License-Identifier: BSD-3-Clause
"""Bags whose files are sound and whose messages are odd: changed, lost, repeated, restamped, on other topics."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from coclo_vio.datasets.images import encoded
from coclo_vio.datasets.rosbag.writing.messages import BagMessages
from coclo_vio.datasets.rosbag.writing.new_bag import new_bag
from coclo_vio.robot.description import load_robot
from coclo_vio.values.calibration import CameraCalibration
from coclo_vio.values.measurements import ImuSample, JointSample
from coclo_vio.values.units import NS_PER_S

START_NS = 1_700_000_000_123_456_789

_FLOATS = (0.0, -1.0, 1e308, -1e300, float("nan"), float("inf"), float("-inf"), 1e-320, 9.81, 5e4)
_STRINGS = (
    "",
    "/",
    "left",
    "\x00",
    "ü" * 300,
    "a" * 5000,
    "world",
    "base_link",
    "/camera/imu",
    "mono16",
    "rgb8",
    "png",
)
_TOPICS = ("/imu", "/camera/imu", "/vicon/x", "/joint_states", "/left/image", "", "/" * 300, "/camera/gyro/sample")
_STAMPS = (0, 1, 2**31 - 1, 2**31 - 2)
_SHARE_CHANGED = 0.15
_FIXED_LENGTHS = (9, 12, 36)  # of covariances, K and R, P, and covariances of poses


def write_odd_bag(rng: Generator, path: Path) -> None:
    """Write a short walk to ``path`` with odd messages; what a bag cannot hold is left out."""
    plan = set(rng.choice(6, int(rng.integers(1, 4)), replace=False).tolist())
    names: dict[str, str] = {}
    with new_bag(path) as bag:
        for topic, stamp_ns, message in walk_messages(BagMessages(bag)):
            if topic not in names:
                names[topic] = _of(rng, _TOPICS) if 3 in plan and rng.random() < 0.3 else topic
            if plan & {4, 5} and rng.random() < _SHARE_CHANGED:
                _change(rng, message, depth=0)
            for at_ns in _stamps(rng, stamp_ns, plan):
                with suppress(Exception):  # rosbags has its own errors for each field that does not fit
                    bag.write(names[topic], at_ns, message, is_latched=topic == "/tf_static")


def walk_messages(make: BagMessages) -> Iterator[tuple[str, int, Any]]:
    """Some messages of every sensor of a Go1: topic, stamp and message, in time order."""
    legs, joints = _names()
    rng = np.random.default_rng(1)
    camera = CameraCalibration(width_px=8, height_px=6, focal_px=(8.0, 8.0), principal_point_px=(4.0, 3.0))
    picture = encoded(np.arange(48, dtype=np.uint8).reshape(6, 8), "png")
    frames = [make.transform(START_NS, "base_link", child, np.eye(4)) for child in ("imu", "left", "right", "cam")]
    yield "/tf_static", START_NS, make.tf(frames)
    for i in range(12):
        at_ns = START_NS + i * 10_000_000
        for topic, frame in (("/imu", "imu"), ("/camera/imu", "cam")):
            reading = ImuSample(at_ns, 0.1 * rng.normal(size=3), np.array([0.0, 0.0, 9.81]) + 0.1 * rng.normal(size=3))
            yield topic, at_ns, make.imu(frame, reading, 1e-5, 1e-4)
        sample = JointSample(at_ns, *rng.normal(size=(3, len(joints))))
        yield "/joint_states", at_ns, make.joints("", joints, sample, with_velocity=True, with_effort=True)
        for leg in legs:
            yield f"/foot_force/{leg}", at_ns, make.foot_force(at_ns, "", 50.0)
        yield "/vicon/go1/go1", at_ns, make.transform(at_ns, "vicon", "go1", np.eye(4))
        if i % 10 == 0:
            for side, baseline_m in (("left", 0.0), ("right", 0.1)):
                yield f"/{side}/camera_info", at_ns, make.camera_info(at_ns, side, camera, baseline_m)
                yield f"/{side}/image_rect/compressed", at_ns, make.image(at_ns, side, picture, "png")


@lru_cache
def _names() -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Legs and joints of a Go1."""
    robot = load_robot("go1")
    return robot.leg_names, robot.joint_names


def _stamps(rng: Generator, stamp_ns: int, plan: set[int]) -> Sequence[int]:
    """When a message is written: not at all, once, twice, or at another time."""
    if 0 in plan and rng.random() < 0.3:
        return ()
    if 1 in plan and rng.random() < 0.2:
        return stamp_ns, stamp_ns
    if 2 in plan and rng.random() < 0.2:
        seconds = _STAMPS[int(rng.integers(len(_STAMPS)))]
        return (seconds * NS_PER_S if rng.random() < 0.3 else max(0, stamp_ns + int(rng.normal(0, 5e8))),)
    return (stamp_ns,)


def _change(rng: Generator, message: Any, depth: int) -> None:
    """One field of a message, or of a message inside it, set to something odd of its type."""
    names = [field.name for field in fields(message) if not field.name.startswith("__")]
    name = names[int(rng.integers(len(names)))]
    value = getattr(message, name)
    if is_dataclass(value) and depth < 5:
        _change(rng, value, depth + 1)
    elif isinstance(value, list) and value and is_dataclass(value[0]):
        _change(rng, value[int(rng.integers(len(value)))], depth + 1)
    else:
        setattr(message, name, _odd(rng, value))


def _odd(rng: Generator, value: Any) -> Any:
    match value:
        case bool():
            return not value
        case int():
            return int(rng.choice([0, 1, 2, 255, 65535, 2**31 - 1]))
        case float():
            return _FLOATS[int(rng.integers(len(_FLOATS)))]
        case str():
            return _of(rng, _STRINGS)
        case np.ndarray():
            return _odd_array(rng, value)
    kept = [each for each in value if rng.random() < 0.7]
    return [*kept, *kept[:1]] if rng.random() < 0.5 else kept


def _odd_array(rng: Generator, value: Any) -> Any:
    """Shorter, backwards, or with one number set; arrays of a fixed length keep it."""
    if len(value) not in _FIXED_LENGTHS and rng.random() < 0.4:
        return value[: int(rng.integers(len(value) + 1))]
    if value.dtype == np.uint8:
        return value[::-1].copy()
    changed = np.array(value)
    if len(changed):
        changed[int(rng.integers(len(changed)))] = _FLOATS[int(rng.integers(len(_FLOATS)))]
    return changed


def _of(rng: Generator, choices: Sequence[str]) -> str:
    return choices[int(rng.integers(len(choices)))]
