# SPDX-License-Identifier: BSD-3-Clause
"""A biped with flat feet and exact trials of it: bodies and soles by formula, joints by inverse kinematics."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from coclo_vio.geometry import se3, so3
from coclo_vio.robot.description import RobotDescription
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array
from coclo_vio.values.measurements import FootForceSample, ImuSample, JointSample, Measurement

RATE_HZ = 100.0
HEEL_M, TOE_M, HALF_WIDTH_M = -0.07, 0.13, 0.045
_REST_S, _STEP_S, _STRIDE_M, _STEPS = 1.0, 0.8, 0.16, 6
WALK_M = _STEPS * _STRIDE_M / 2.0
GRAVITY = np.array([0.0, 0.0, -9.81])
_HIP_M, _THIGH_M, _SHANK_M, _ANKLE_M = 0.09, 0.32, 0.32, 0.06
_JOINTS = ("hip_yaw", "hip_roll", "hip_pitch", "knee", "ankle_pitch", "ankle_roll")
_AXES = ("0 0 1", "1 0 0", "0 1 0", "0 1 0", "0 1 0", "1 0 0")
_DROPS_M = (0.0, 0.0, 0.0, _THIGH_M, _SHANK_M, 0.0)


def write_biped(
    folder: Path, *, has_sole_shape: bool = True, sole_name: str = "sole", **changes: object
) -> RobotDescription:
    """The description of the biped, whose URDF is written into ``folder``."""
    path = folder / "biped.urdf"
    legs_text = [_leg(side, has_sole_shape).replace("_sole", f"_{sole_name}") for side in "lr"]
    path.write_text(f'<robot name="biped">{_link("base", 8.0)}{"".join(legs_text)}</robot>')
    legs = [
        {"name": name, "joints": [f"{name[0]}_{joint}" for joint in _JOINTS], "foot_frame": f"{name[0]}_{sole_name}"}
        for name in ("left", "right")
    ]
    contact = {"source": "force_sensor", "on_force": 40.0, "off_force": 20.0}
    values = {"name": "biped", "urdf": str(path), "legs": legs, "contact": contact, **changes}
    return RobotDescription.parse(values, "biped")


def _link(name: str, mass_kg: float, shape: str = "") -> str:
    inertia = '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
    inertial = f'<inertial><mass value="{mass_kg}"/><origin xyz="0 0 0"/>{inertia}</inertial>'
    return f'<link name="{name}">{inertial if mass_kg else ""}{shape}</link>'


def _leg(side: str, has_sole_shape: bool) -> str:
    parent, text = "base", ""
    for joint, axis, drop_m in zip(_JOINTS, _AXES, _DROPS_M, strict=True):
        lateral_m = (_HIP_M if side == "l" else -_HIP_M) if parent == "base" else 0.0
        child = f"{side}_{joint}_link"
        text += (
            f'<joint name="{side}_{joint}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="0 {lateral_m} {-drop_m}"/><axis xyz="{axis}"/>'
            f'<limit lower="-2.5" upper="2.5" effort="100" velocity="20"/></joint>{_link(child, 0.8)}'
        )
        parent = child
    size, centre = (TOE_M - HEEL_M, 2.0 * HALF_WIDTH_M, 0.02), (0.5 * (TOE_M + HEEL_M), 0.0, 0.01)
    shape = "<collision><origin xyz='{} {} {}'/><geometry><box size='{} {} {}'/></geometry></collision>"
    sole = _link(f"{side}_sole", 0.0, shape.format(*centre, *size) if has_sole_shape else "")
    return text + (
        f'{sole}<joint name="{side}_sole_joint" type="fixed"><parent link="{parent}"/><child link="{side}_sole"/>'
        f'<origin xyz="0 0 {-_ANKLE_M}"/></joint>'
    )


@dataclass(frozen=True)
class Noise:
    """One sigma of each sensor, and the gyroscope's bias, rad/s, with its drift; of each trial the accelerometer's."""

    encoder_rad: float = 5e-4
    velocity_radps: float = 0.02
    rate_radps: float = 0.003
    force_mps2: float = 0.05
    rate_bias_radps: float = 0.0
    rate_drift_radps2: float = 0.0
    force_bias_mps2: float = 0.0


PoseAt = Callable[[float], Array]


@dataclass(frozen=True)
class FlatTrial:
    """A motion of body and soles without noise.

    Attributes:
        times_s: of the joint samples, (N,).
        T_world_body: (N, 4, 4).
        positions: of the joints, rad, (N, 12).
        body_at: the body's pose at any time.
        loads_at: on the feet, N, (2,), at any time.
    """

    times_s: Array
    T_world_body: Array
    positions: Array
    body_at: PoseAt
    loads_at: Callable[[float], Array]

    @property
    def stamps_ns(self) -> Array:
        """Of the joint samples, (N,)."""
        return np.round(self.times_s * 1e9).astype(np.int64) + 1_000_000_000

    def measurements(self, noise: Noise, seed: int) -> Iterator[Measurement]:
        """In time order."""
        rng = np.random.default_rng(seed)
        return _measurements(self, noise, rng)


def flat_trial(
    robot: RobotModel,
    body_at: PoseAt,
    soles_at: tuple[PoseAt, PoseAt],
    loads_at: Callable[[float], Array],
    duration_s: float,
) -> FlatTrial:
    """A trial in which body and soles are at given poses ``T_world_...`` (4, 4), and feet carry loads in N, (2,)."""
    times_s = np.arange(0.0, duration_s, 1.0 / RATE_HZ)
    bodies = np.array([body_at(time_s) for time_s in times_s])
    return FlatTrial(times_s, bodies, _joints(robot, times_s, bodies, soles_at), body_at, loads_at)


def _joints(robot: RobotModel, times_s: Array, bodies: Array, soles_at: tuple[PoseAt, PoseAt]) -> Array:
    joints = np.tile([0.0, 0.0, -0.4, 0.8, -0.4, 0.0], 2)
    positions = np.empty((len(times_s), 12))
    for row, (time_s, T_world_body) in enumerate(zip(times_s, bodies, strict=True)):
        targets = [se3.inverse(T_world_body) @ sole_at(time_s) for sole_at in soles_at]
        for _ in range(20):
            feet = robot.feet(joints, np.zeros(12))
            error = np.zeros(12)
            for leg, target in enumerate(targets):
                turn = so3.log(target[:3, :3] @ feet.rotation_body_foot[leg].T)
                error[6 * leg : 6 * leg + 6] = [*turn, *(target[:3, 3] - feet.position_body[leg])]
            if np.abs(error).max() < 1e-10:
                break
            joints = joints + np.linalg.solve(feet.jacobian.reshape(12, 12), error)
        positions[row] = joints
    return positions


def _measurements(trial: FlatTrial, noise: Noise, rng: np.random.Generator) -> Iterator[Measurement]:
    velocities = np.gradient(trial.positions, trial.times_s, axis=0)
    step_s, force_bias = 1e-4, rng.normal(0.0, 1.0, 3) * noise.force_bias_mps2
    for row, (time_s, stamp_ns) in enumerate(zip(trial.times_s, trial.stamps_ns.tolist(), strict=True)):
        before, here, after = (trial.body_at(time_s + offset) for offset in (-step_s, 0.0, step_s))
        rate = so3.log(before[:3, :3].T @ after[:3, :3]) / (2.0 * step_s)
        acceleration = (after[:3, 3] - 2.0 * here[:3, 3] + before[:3, 3]) / step_s**2
        force = here[:3, :3].T @ np.subtract(acceleration, GRAVITY)
        gyroscope = (
            rate + noise.rate_bias_radps + noise.rate_drift_radps2 * time_s + rng.normal(0.0, noise.rate_radps, 3)
        )
        yield FootForceSample(stamp_ns, trial.loads_at(time_s))
        yield ImuSample(stamp_ns, gyroscope, force + force_bias + rng.normal(0.0, noise.force_mps2, 3))
        yield JointSample(
            stamp_ns,
            trial.positions[row] + rng.normal(0.0, noise.encoder_rad, 12),
            velocities[row] + rng.normal(0.0, noise.velocity_radps, 12),
            np.full(12, np.nan),
        )


def smooth(share: float) -> float:
    """From 0 to 1 with zero first and second derivative at both ends."""
    x = min(max(share, 0.0), 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


def rocked(place: Array, angle_rad: float) -> Array:
    """``T_world_sole`` (4, 4) of a sole at ``place`` (3,), rocked on its toe by a positive angle, on its heel else."""
    pivot = np.array([TOE_M if angle_rad > 0.0 else HEEL_M, 0.0, 0.0])
    rotation = so3.exp(np.array([0.0, angle_rad, 0.0]))
    return se3.transform(rotation, place + pivot - rotation @ pivot)


def walk(robot: RobotModel) -> FlatTrial:
    """Six steps of 0.08 m after a second of rest; each foot leaves over its toe and lands on its heel."""
    soles = partial(_walking, 1.0), partial(_walking, -1.0)
    return flat_trial(robot, _walking_body, soles, _walking_loads, _REST_S + _STEPS * _STEP_S + 0.5)


def _walking_body(time_s: float) -> Array:
    steps = _STEPS * smooth((time_s - _REST_S) / (_STEPS * _STEP_S))
    place = np.array([_STRIDE_M / 2 * steps, 0.0, 0.6])
    return se3.transform(so3.exp(np.array([0.0, 0.0, 0.05 * np.sin(time_s) * smooth(time_s - _REST_S)])), place)


def _swing(side: float, time_s: float) -> tuple[int, float]:
    """How many swings this foot has finished, and the phase of the one it is in; 0 while it stands."""
    phase = (time_s - _REST_S) / _STEP_S - (0.0 if side > 0.0 else 1.0)
    number, share = int(np.floor(phase / 2.0)), phase / 2.0 % 1.0
    if phase < 0.0 or number >= _STEPS // 2:
        return max(0, min(number, _STEPS // 2)), 0.0
    return (number, 2.0 * share) if share < 0.5 else (number + 1, 0.0)


def _walking(side: float, time_s: float) -> Array:
    """Over the toe, through the air, on to the heel and down: in one step time, the toe still carries at first."""
    done, phase = _swing(side, time_s)
    start = np.array([_STRIDE_M * done, side * _HIP_M, 0.0])
    toe_off, flight = smooth(phase / 0.3), smooth((phase - 0.3) / 0.4)
    landing = smooth((phase - 0.7) / 0.3)
    angle = 0.3 * toe_off - 0.5 * flight + 0.2 * landing
    pose = rocked(start, angle)
    pose[:3, 3] += [_STRIDE_M * flight, 0.0, 0.04 * np.sin(np.pi * flight)]
    return pose


def _walking_loads(time_s: float) -> Array:
    phases = [_swing(side, time_s)[1] for side in (1.0, -1.0)]
    return np.array([0.0 if 0.3 < phase < 0.7 else 150.0 for phase in phases])
