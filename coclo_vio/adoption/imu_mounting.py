# SPDX-License-Identifier: BSD-3-Clause
"""How the IMU is mounted: its tilt by gravity against the floor under the feet, its heading by turning with the feet.

With n the normal of the floor and g the mean specific force, ``R_body_imu g`` is along n. What is left, a rotation
about n, is that for which the gyroscope explains how the vector between two standing feet turns:
``R omega x d = -d_dot``, with d and its rate from the joints.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from coclo_vio.adoption.recorded_legs import RecordedLegs
from coclo_vio.adoption.stance_motion import FeetMotion, StandingPairs, floor_normal
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array, BoolArray, IntArray
from coclo_vio.values.units import GRAVITY_MPS2

_NEAR_RAD = 0.15  # a mounting of the URDF or along the axes this near to the measured one is taken to be the true one
_HEADINGS = 360
_LEAST_FORCE_MPS2 = 0.5  # an accelerometer that reads less at rest has no gravity in it, in whatever unit
_FAR_BETTER = 0.5  # share of the squared residual, from which the gyroscope reads degrees
_KEPT = 0.8  # share of the pairs that is kept once those that slip are known
_FLAT_SHARE = 0.1  # spread of the feet across the line of the two farthest, from which they span a plane
_HEADING_RAD = 0.2  # standard deviation from which a heading is known: mountings differ by 90 degrees
_INDEPENDENT_SHARE = 0.05  # of the pairs of feet: those that follow one another err alike
_DELAYS_S = np.arange(-0.03, 0.0301, 0.002)


@dataclass(frozen=True, slots=True, eq=False)
class ImuMounting:
    """A mounting that was found.

    Attributes:
        rotation: ``R_body_imu``, (3, 3).
        is_tilt_known: whether the floor under the feet gave the tilt.
        is_heading_known: whether turning distinguished the heading.
        source: where the rotation is from: a link of the URDF, the axes of the body, or what was measured.
        measured: as measured, before the nearest plausible one was taken, (3, 3).
        apart_rad: angle between the two.
        delay_s: by which the gyroscope is late behind the joints, s; None where it was not observed.
        is_gyroscope_in_degrees: whether its rates are deg/s.
        force_mps2: mean length of the specific force while standing, m/s^2.
        confidence: 0..1.
    """

    rotation: Array
    is_tilt_known: bool
    is_heading_known: bool
    source: str
    measured: Array
    apart_rad: float
    delay_s: float | None
    is_gyroscope_in_degrees: bool
    force_mps2: float
    confidence: float


@dataclass(frozen=True, slots=True, eq=False)
class _Turning:
    """Rows ``cross(R rate, lever) = change``, or ``R rate = change`` where the lever is None."""

    rate: Array
    lever: Array | None
    change: Array

    def residuals(self, rotation: Array) -> Array:
        turned = self.rate @ rotation.T
        predicted = turned if self.lever is None else np.cross(turned, self.lever)
        return np.asarray(np.linalg.norm((predicted - self.change) / self._length(), axis=1))

    def gram(self, upright: Array, normal: Array) -> Array:
        """Matrix (3, 3) whose form with [1, cos, sin] of a heading about ``normal`` is the mean squared residual."""
        level = self.rate @ upright.T
        along = np.outer(level @ normal, normal)
        parts = [along, level - along, np.cross(normal, level)]
        if self.lever is not None:
            parts = [np.cross(part, self.lever) for part in parts]
        parts[0] = parts[0] - self.change
        stacked = np.stack([part / self._length() for part in parts])
        return np.asarray(np.einsum("ink,jnk->ij", stacked, stacked) / len(self.rate))

    def _length(self) -> Array:
        """Of the levers, m, (n, 1); 1 where there are none."""
        if self.lever is None:
            return np.ones((1, 1))
        return np.asarray(np.linalg.norm(self.lever, axis=1, keepdims=True))


def find_mounting(
    recorded: RecordedLegs,
    motion: FeetMotion,
    is_stance: BoolArray,
    pairs: StandingPairs,
    *,
    flat_normals: Array | None,
    known: Mapping[str, Array],
) -> ImuMounting:
    """Find the rotation of the IMU on the body.

    Args:
        recorded: joints and IMU.
        motion: the feet.
        is_stance: which feet stand, (N, legs).
        pairs: of standing feet.
        flat_normals: of flat feet, the axis of the foot that points up, (legs, 3); None of round ones.
        known: rotations (3, 3) of the IMU links of the URDF, by name.
    """
    is_rest = recorded.is_rest()
    normal, is_tilt_known = _floor(motion, is_stance, is_rest, flat_normals)
    samples = is_rest if is_rest.any() else is_stance.any(axis=1)
    force = recorded.imu_at_joints()[1][samples].mean(axis=0)
    length = float(np.linalg.norm(force))
    is_tilt_known = is_tilt_known and length > _LEAST_FORCE_MPS2
    upright = _shortest(force / length, normal) if length > _LEAST_FORCE_MPS2 else np.eye(3)
    turning = _turning(recorded, motion, is_stance, pairs, has_flat_feet=flat_normals is not None)
    heading, sigma, cost = _heading(turning, upright, normal)
    from_degrees = _heading(replace(turning, rate=np.radians(turning.rate)), upright, normal)
    in_degrees = from_degrees[2] < _FAR_BETTER * cost
    if in_degrees:
        recorded = replace(recorded, angular_velocity=np.radians(recorded.angular_velocity))
        heading, sigma, _ = from_degrees
    is_heading_known = sigma < _HEADING_RAD
    measured = so3.exp(normal * heading) @ upright
    rotation, source, apart = _plausible(measured, normal, known, is_heading_known=is_heading_known)
    confidence = 0.3 + 0.3 * is_tilt_known + 0.35 * is_heading_known * (1.0 - 0.5 * sigma / _HEADING_RAD)
    if source == "measured":
        confidence *= 0.7
    return ImuMounting(
        rotation=rotation,
        is_tilt_known=is_tilt_known,
        is_heading_known=is_heading_known,
        source=source,
        measured=measured,
        apart_rad=apart,
        delay_s=_delay(recorded, motion, is_stance, pairs, rotation, flat_normals) if is_heading_known else None,
        is_gyroscope_in_degrees=in_degrees,
        force_mps2=length,
        confidence=confidence,
    )


def scale_of_force(length_mps2: float) -> str | None:
    """The unit of an accelerometer that reads this at rest, where that is not m/s^2."""
    if abs(length_mps2 - GRAVITY_MPS2) < 1.5:
        return None
    if length_mps2 < _LEAST_FORCE_MPS2:
        return "without gravity"
    return {1: "g", 1000: "mg", 981: "cm/s^2"}.get(round(length_mps2), f"unknown, of {length_mps2:.3g} at rest")


def _floor(
    motion: FeetMotion, is_stance: BoolArray, is_rest: BoolArray, flat_normals: Array | None
) -> tuple[Array, bool]:
    """The normal of the floor in body axes, and whether the feet determine it."""
    if flat_normals is not None:
        samples = is_rest if is_rest.any() else is_stance.any(axis=1)
        normals = np.einsum("nlij,lj->nli", motion.rotation[samples], flat_normals)
        mean = np.nanmean(normals, axis=(0, 1))
        return mean / np.linalg.norm(mean), True
    up = np.array([0.0, 0.0, 1.0])
    for _ in range(2):  # the contact point of a round foot depends on the normal a little
        points, _ = motion.contact_points(up)
        standing = np.nanmean(points[is_rest], axis=0) if is_rest.any() else points[is_stance]
        up, span = floor_normal(standing[np.isfinite(standing).all(axis=1)])
        if span < _FLAT_SHARE and is_rest.any():
            up, span = floor_normal(points[is_stance & np.isfinite(points).all(axis=2)])
        if span < _FLAT_SHARE:
            return np.array([0.0, 0.0, 1.0]), False
    return up, True


def _turning(
    recorded: RecordedLegs,
    motion: FeetMotion,
    is_stance: BoolArray,
    pairs: StandingPairs,
    *,
    has_flat_feet: bool,
    delay_s: float = 0.0,
) -> _Turning:
    rate = recorded.imu_at_joints(delay_s)[0]
    is_rest = recorded.is_rest()
    bias = rate[is_rest].mean(axis=0) if is_rest.any() else np.zeros(3)
    rate = rate - bias
    if has_flat_feet:
        rows, legs = np.nonzero(is_stance & np.isfinite(motion.angular_velocity).all(axis=2))
        return _Turning(rate[rows], None, -motion.angular_velocity[rows, legs])
    return _Turning(rate[pairs.sample], pairs.apart, -pairs.velocity)


def _heading(turning: _Turning, upright: Array, normal: Array) -> tuple[float, float, float]:
    """Heading about the normal by least squares and its standard deviation, rad; the mean squared residual."""
    if len(turning.rate) < 50:
        return 0.0, float("inf"), 0.0
    headings = np.linspace(-np.pi, np.pi, _HEADINGS, endpoint=False)
    terms = np.column_stack((np.ones(_HEADINGS), np.cos(headings), np.sin(headings)))
    kept = turning
    for _ in range(2):
        gram = kept.gram(upright, normal)
        costs = np.einsum("hi,ij,hj->h", terms, gram, terms)
        best = int(np.argmin(costs))
        residuals = kept.residuals(so3.exp(normal * headings[best]) @ upright)
        kept = _rows(kept, np.flatnonzero(residuals <= np.quantile(residuals, _KEPT)))
    half_range = 0.5 * float(costs.max() - costs[best])  # the cost is a cosine of the heading
    independent = len(kept.rate) * _INDEPENDENT_SHARE
    variance = float(costs[best]) / max(independent * half_range, 1e-12)
    return float(headings[best]), float(np.sqrt(variance)), float(costs[best])


def _rows(turning: _Turning, rows: IntArray) -> _Turning:
    lever = None if turning.lever is None else turning.lever[rows]
    return _Turning(turning.rate[rows], lever, turning.change[rows])


def _plausible(
    measured: Array, normal: Array, known: Mapping[str, Array], *, is_heading_known: bool
) -> tuple[Array, str, float]:
    """The mounting of the URDF or along the axes that is near the measured one, its name, and how near it is, rad.

    Without a known heading only the tilt is compared.
    """

    def apart(rotation: Array) -> float:
        if is_heading_known:
            return float(np.linalg.norm(so3.log(measured.T @ rotation)))
        cosine = float((measured.T @ normal) @ (rotation.T @ normal))
        return float(np.arccos(np.clip(cosine, -1.0, 1.0)))

    candidates = {**known, "the axes of the body": np.eye(3)}
    candidates |= {f"turned axes {number}": rotation for number, rotation in enumerate(_axis_rotations())}
    for name, rotation in candidates.items():
        if apart(rotation) < _NEAR_RAD:
            return rotation, name if name in known else "axes", apart(rotation)
    return measured, "measured", 0.0


def _axis_rotations() -> list[Array]:
    """The 24 rotations that bring axes onto axes."""
    quarter = np.pi / 2
    found: list[Array] = []
    for x in range(4):
        for y in range(4):
            for z in range(4):
                rotation = so3.about_z(z * quarter) @ so3.exp(np.array([0.0, y * quarter, 0.0]))
                rotation = np.round(rotation @ so3.exp(np.array([x * quarter, 0.0, 0.0])))
                if not any(np.array_equal(rotation, other) for other in found):
                    found.append(rotation)
    return found


def _delay(
    recorded: RecordedLegs,
    motion: FeetMotion,
    is_stance: BoolArray,
    pairs: StandingPairs,
    rotation: Array,
    flat_normals: Array | None,
) -> float | None:
    """The delay at which the gyroscope explains the turning best; None at the end of the range."""
    costs = []
    for delay_s in _DELAYS_S:
        turning = _turning(
            recorded, motion, is_stance, pairs, has_flat_feet=flat_normals is not None, delay_s=float(delay_s)
        )
        residuals = turning.residuals(rotation)
        costs.append(float(np.mean(np.minimum(residuals, np.quantile(residuals, _KEPT)) ** 2)))
    best = int(np.argmin(costs))
    if best in {0, len(costs) - 1} or costs[best] > 0.98 * max(costs[0], costs[-1]):
        return None
    return float(_DELAYS_S[best])


def _shortest(start: Array, end: Array) -> Array:
    """The smallest rotation (3, 3) that brings one unit vector onto another."""
    axis, cosine = np.cross(start, end), float(start @ end)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:
        other = np.array([1.0, 0.0, 0.0]) if abs(start[0]) < 0.9 else np.array([0.0, 1.0, 0.0])
        across = np.cross(start, other)
        return np.eye(3) if cosine > 0.0 else so3.exp(np.pi * across / np.linalg.norm(across))
    return so3.exp(axis / sine * np.arctan2(sine, cosine))
