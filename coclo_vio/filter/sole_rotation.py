# SPDX-License-Identifier: BSD-3-Clause
"""The orientation that flat feet hold: further measurements of the body's rotation.

A point foot holds a place; a sole that stands flat holds its orientation too. With ``F`` the orientation of a sole in
the world, and ``M = R_body_foot`` by the joints, ``M = R^T F``. The errors of ``F`` are three more states a sole,
``F = exp(e_F) F_mean``; with ``R = exp(e_R) R_mean``

    log(R_mean M F_mean^T) = e_F - e_R + noise.

A sole's orientation is what body and joints show once it has come to rest on the ground: ``F = R M``, ``e_F = e_R``
plus noise. A rotation of the world moves both alike and is not observed, as everywhere in this filter. While the sole
rests the rows hold the body's rotation against the drift of the gyroscope, in yaw too, which nothing else measures.

A leg's error of rotation (backlash, bending, encoder counts) changes with load and posture, over a second and not from
sample to sample. So there is one measurement in each ``interval_s``, with the noise that makes the measurements of one
``foot_rotation_memory_s`` count as one. A sole that rotates, on its heel or toe or because it swings, has no rows: its
orientation is taken anew once it rests again.
"""

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from coclo_vio.filter.config import RobustConfig
from coclo_vio.filter.square_root_filter import SquareRootFilter
from coclo_vio.filter.state import ROTATION
from coclo_vio.filter.state_blocks import StateBlock
from coclo_vio.filter.unscented_transform import lower_factor
from coclo_vio.geometry import so3
from coclo_vio.robot.leg_sensing import Reading
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.units import NS_PER_S

SOLES = "soles"
"""Name of the block of the state."""

_INTERVAL_S = 0.1
_UNKNOWN_RAD = 0.5  # sigma of an orientation that is not held


def sole_block(robot: RobotModel, config: RobustConfig) -> StateBlock | None:
    """The errors of the orientations of the flat feet, world axes, three each; None without flat feet."""
    count = sum(leg.is_flat for leg in robot.description.legs)
    if not count or not config.holds_soles:
        return None
    return StateBlock(SOLES, 3 * count, sigma=_UNKNOWN_RAD, walk=config.sole_creep_rad)


@dataclass(slots=True)
class _Sole:
    """A flat foot.

    Attributes:
        leg: its leg.
        errors: its rows of the state.
        rotation: ``F``, ``R_world_foot`` while it holds, (3, 3).
        before: ``R_world_foot`` at the last measurement, None unless it stood then.
        holds: whether its orientation is held.
    """

    leg: int
    errors: slice
    rotation: Array
    before: Array | None = None
    holds: bool = False


class SoleRotation:
    """Updates the filter by the orientation of the flat feet that rest.

    Args:
        robot: the legs.
        config: noise.
        first_error: of the block ``SOLES``.
        counts: where soles are counted that hold anew, and measurements beyond the gate.
    """

    def __init__(self, robot: RobotModel, config: RobustConfig, first_error: int, counts: Counter[str]) -> None:
        legs = [number for number, leg in enumerate(robot.description.legs) if leg.is_flat]
        self._soles = [
            _Sole(leg, slice(first_error + 3 * row, first_error + 3 * row + 3), np.eye(3))
            for row, leg in enumerate(legs)
        ]
        self._encoder_rad, self._config, self._counts = robot.description.encoder_noise_rad, config, counts
        self._limit = float(chi2.ppf(config.gate_probability, 3))
        self._steady_rad = config.sole_steady_radps * _INTERVAL_S
        self._stamp_ns: int | None = None

    @property
    def holds(self) -> BoolArray:
        """Flat feet whose orientation is held, (flat feet,)."""
        return np.array([sole.holds for sole in self._soles])

    def update(self, core: SquareRootFilter, reading: Reading, is_stance: BoolArray, *, is_gap: bool) -> None:
        """Take a reading after the other measurements of its time.

        Args:
            core: the filter.
            reading: the joints.
            is_stance: legs that stand and were not rejected, (n,).
            is_gap: whether joint readings were missing before it.
        """
        for sole in self._soles:
            if is_gap or not is_stance[sole.leg]:
                sole.holds, sole.before = False, None
        if self._stamp_ns is not None and reading.stamp_ns - self._stamp_ns < _INTERVAL_S * NS_PER_S:
            return
        self._stamp_ns = reading.stamp_ns
        for sole in self._soles:
            if is_stance[sole.leg]:
                self._take(core, sole, reading)

    def _take(self, core: SquareRootFilter, sole: _Sole, reading: Reading) -> None:
        now = core.mean.rotation @ reading.feet.rotation_body_foot[sole.leg]
        before, sole.before = sole.before, now
        if before is None or np.linalg.norm(so3.log(now @ before.T)) > self._steady_rad:
            sole.holds = False
            return
        noise = self._noise(core, reading, sole.leg)
        if not sole.holds:
            self._hold(core, sole, now, noise)
            return
        sole.rotation = so3.exp(core.mean.vector[sole.errors]) @ sole.rotation
        _clear(core, sole.errors)
        innovation = so3.log(now @ sole.rotation.T)
        rows = (core.active_factor[sole.errors] - core.active_factor[ROTATION]).T
        share = np.sqrt(max(self._config.foot_rotation_memory_s / _INTERVAL_S, 1.0))
        factor = share * noise
        normalised = innovation @ np.linalg.solve(rows.T @ rows + factor @ factor.T, innovation)
        if normalised > self._limit:
            self._counts["sole_rejected"] += 1
            sole.holds, sole.before = False, None
            return
        core.update(np.ascontiguousarray(rows), np.ascontiguousarray(factor.T), innovation)

    def _noise(self, core: SquareRootFilter, reading: Reading, leg: int) -> Array:
        """Lower factor of the covariance of a foot's rotation by the joints, rad, world axes, (3, 3)."""
        angular = core.mean.rotation @ reading.feet.jacobian[leg, :3]
        encoders = angular @ angular.T * self._encoder_rad**2
        return np.asarray(np.linalg.cholesky(encoders + self._config.foot_rotation_noise_rad**2 * np.eye(3)))

    def _hold(self, core: SquareRootFilter, sole: _Sole, rotation: Array, noise: Array) -> None:
        """The orientation becomes that of body and joints, with their errors."""
        self._counts["sole_held"] += 1
        sole.rotation, sole.holds = rotation, True
        _clear(core, sole.errors)
        rows = core.active_factor.T.copy()
        rows[:, sole.errors] = core.active_factor[ROTATION].T
        added = np.zeros((3, rows.shape[1]))
        added[:, sole.errors] = noise.T
        core.passive.cross[sole.errors] = core.passive.cross[ROTATION]
        core.replace_active(lower_factor(np.concatenate((rows, added))))


def _clear(core: SquareRootFilter, errors: slice) -> None:
    """What was corrected is in the orientation itself from now on."""
    vector = core.mean.vector.copy()
    vector[errors] = 0.0
    core.mean = replace(core.mean, vector=vector)
