# SPDX-License-Identifier: BSD-3-Clause
"""How each foot moved from one reading to the next."""

from typing import NamedTuple

import numpy as np

from coclo_vio.filter import stance_kernel
from coclo_vio.filter.ground_plane import GroundPlane
from coclo_vio.filter.load_transfer import LoadTransfer
from coclo_vio.geometry import so3
from coclo_vio.geometry.compiled import IS_COMPILED
from coclo_vio.robot.leg_sensing import Reading
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.units import NS_PER_S

__all__ = ["FootMotion", "Footholds", "Reading", "load_ratio_of", "turns_of"]

_MAX_LOAD_RATIO = 20.0  # a larger load is a sensor fault


class FootMotion(NamedTuple):
    """How the feet moved from one joint sample to the next.

    Attributes:
        holds: feet in stance at both ends whose foothold is valid, (n,).
        position_body: foot centres now, m, body frame, (n, 3); for an unknown leg its last known position.
        turn_body: rotation of the foot link relative to the body, as a rotation vector in the body axes of the
            earlier time, (n, 3): ``exp(turn) = R_body_foot(now) R_body_foot(before)^T``.
        is_known: legs whose kinematics are known now, (n,).
        load_ratio: load on each foot as a multiple of the load from which a foot stands, (n,); where unknown the last
            known one, 0 before.
        load_ratio_rate: its rate of change, 1/s, (n,); 0 where unknown.
        normals: of the ground under each foot, on which it rolls, world, (n, 3).
        takeover_speed: speed that the slip by takeover of weight is a share of, m/s (``LoadTransfer``).
    """

    holds: BoolArray
    position_body: Array
    turn_body: Array
    is_known: BoolArray
    load_ratio: Array
    load_ratio_rate: Array
    normals: Array
    takeover_speed: float


def load_ratio_of(reading: Reading, standing_load: float, before: Array) -> Array:
    """Load on each foot over the load from which a foot stands, (n,); ``before`` (n,) where it is unknown."""
    load = reading.contact.load
    ratio = np.minimum(np.maximum(load / standing_load, 0.0), _MAX_LOAD_RATIO)
    return np.where(np.isfinite(load), ratio, before)


def load_change(load: Array, standing_load: float, most: float, ratio: Array, is_loaded: BoolArray) -> Array:
    """Follow the load ratios of the feet; the change of each, (n,), 0 where the load is or was unknown.

    Args:
        load: on each foot, N or counts, (n,); not finite where unknown.
        standing_load: from which a foot stands, in the same unit.
        most: a larger ratio is a sensor fault.
        ratio: last known load ratios, (n,); is updated.
        is_loaded: feet whose load was known, (n,); is updated.
    """
    known = np.isfinite(load)
    now = np.where(known, np.minimum(np.maximum(load / standing_load, 0.0), most), ratio)
    change = np.where(known & is_loaded, now - ratio, 0.0)
    ratio[:], is_loaded[:] = now, known
    return change


def turns_of(holds: BoolArray, rotation: Array, before: Array) -> Array:
    """Rotation vectors (n, 3) from earlier to later rotations of the feet (n, 3, 3); 0 where one does not hold."""
    relative = np.where(holds[:, None, None], rotation @ np.swapaxes(before, 1, 2), np.eye(3))
    return so3.log_below_pi(relative)


def _weights_of(reading: Reading) -> Array:
    """What each foot carries, (n,): by the loads where all are known, otherwise by the probabilities of contact."""
    return np.maximum(reading.contact.load, 0.0) if _has_loads(reading) else reading.contact.probability


def _has_loads(reading: Reading) -> bool:
    """Whether the loads on all feet are known."""
    return bool(np.isfinite(reading.contact.load).all())


class Footholds:
    """Remembers the last kinematics and which footholds are still valid.

    A foot that swings, slips or is unknown is carried with the body until it stands again.
    """

    def __init__(
        self,
        reading: Reading,
        standing_load: float,
        ground: GroundPlane | None = None,
        *,
        follows_takeover: bool = True,
    ) -> None:
        """Remember the first reading.

        Args:
            reading: it.
            standing_load: N or counts, from which a foot stands.
            ground: follows the ground under the feet; None for level ground.
            follows_takeover: whether the speed by takeover of weight is wanted; otherwise it is 0.
        """
        self._standing_load = standing_load
        self.ground = ground or GroundPlane(len(reading.contact.load))
        self._transfer = LoadTransfer(_weights_of(reading)) if follows_takeover else None
        self._has_loads = _has_loads(reading)
        self._stamp_ns = reading.stamp_ns
        self._load_ratio = load_ratio_of(reading, standing_load, before=np.zeros(len(reading.contact.load)))
        self._is_loaded = np.isfinite(reading.contact.load)
        self._has_foothold = reading.is_stance
        self._rotation_body_foot = np.nan_to_num(reading.feet.rotation_body_foot)
        self._position_body = np.nan_to_num(reading.feet.position_body)

    def advance(self, reading: Reading, *, speed_mps: float, is_gap: bool) -> FootMotion:
        """Take the next reading, with the body's speed before it, m/s; after a gap no foothold is valid."""
        if is_gap:
            self.ground.clear()
        is_known = reading.is_known
        holds = self._has_foothold & reading.is_stance & (not is_gap)
        rotation = reading.feet.rotation_body_foot
        turns = (stance_kernel.turns_of if IS_COMPILED else turns_of)(holds, rotation, self._rotation_body_foot)
        position = reading.feet.position_body
        if np.count_nonzero(is_known) < len(is_known):
            position = np.where(is_known[:, None], position, self._position_body)
        self._has_foothold = reading.is_stance
        self._rotation_body_foot = rotation
        self._position_body = position
        dt_s, self._stamp_ns = (reading.stamp_ns - self._stamp_ns) / NS_PER_S, reading.stamp_ns
        load_ratio = self._load_ratio = self._load_ratio.copy()  # what was returned before does not change
        load_ratio_rate = (stance_kernel.load_change if IS_COMPILED else load_change)(
            reading.contact.load, self._standing_load, _MAX_LOAD_RATIO, load_ratio, self._is_loaded
        )
        load_ratio_rate /= dt_s
        takeover_speed = self._takeover_speed(reading, speed_mps, dt_s, is_gap=is_gap)
        normals = self.ground.normals
        return FootMotion(holds, position, turns, is_known, load_ratio, load_ratio_rate, normals, takeover_speed)

    def _takeover_speed(self, reading: Reading, speed_mps: float, dt_s: float, *, is_gap: bool) -> float:
        """By weights that continue those before; otherwise it begins with them, and is 0."""
        if self._transfer is None:
            return 0.0
        had_loads, self._has_loads = self._has_loads, _has_loads(reading)
        if is_gap or self._has_loads != had_loads:
            self._transfer.restart(_weights_of(reading))
            return 0.0
        return self._transfer.push(_weights_of(reading), reading.is_stance, speed_mps, dt_s)

    def carried(self) -> FootMotion:
        """All feet carried with the body from their last known positions, while there is no joint sample."""
        legs = len(self._has_foothold)
        none = np.zeros(legs, dtype=np.bool_)
        normals, still = self.ground.normals, np.zeros((legs, 3))
        return FootMotion(none, self._position_body, still, none, self._load_ratio, np.zeros(legs), normals, 0.0)

    def release(self, legs: BoolArray) -> None:
        """Drop the footholds of these legs (n,): they slipped."""
        self._has_foothold = self._has_foothold & ~legs
