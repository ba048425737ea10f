# SPDX-License-Identifier: BSD-3-Clause
"""How a gyroscope's axes and unit differ from what standing feet, another gyroscope or cameras measure.

The body's angular velocity is ``w = M m + b`` of a gyroscope's reading ``m`` in the axes that its mounting claims. M is
the identity where unit, axes and mounting are right; pi/180 where the readings are in degrees; a rotation where the
mounting is another. Pairs of standing feet tell which without an IMU: the vector d between them is fixed in the world,
so that in the body

    d(end) - d(start) = integral of d x w dt = integral of hat(d) M m dt.

Two feet do not determine M, as a rotation about d is not seen; so the units and axes that occur are compared by how
much of the changes each leaves.
"""

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from coclo_vio.datasets.corrections import axes_matrix
from coclo_vio.diagnosis.feet import FeetRecord
from coclo_vio.geometry import so3
from coclo_vio.values.arrays import Array, IntArray
from coclo_vio.values.units import NS_PER_S

_WINDOW_S = 0.1
_FEWEST = 30
_LEAST_SHARE = 0.15  # of the largest excitation: an axis with less is not judged
_TRIM = 3.0  # robust sigmas beyond which a window is left out
_TO_SIGMA = 1.4826
_PASSES = 4
_LONGEST_DELAY_S, _COARSE_STEP_S, _FINE_STEP_S = 0.2, 0.02, 0.005
_EXPLAINED = 0.85  # at most is left at the best delay
_UNITS = {"rad/s": 1.0, "deg/s": np.pi / 180.0}


@dataclass(frozen=True, slots=True, eq=False)
class RateFit:
    """A fit of ``w = M m + b``.

    Attributes:
        matrix: M, (3, 3).
        scale: factor from the measured to the true rate.
        rotation: from the claimed to the true axes, (3, 3).
        correlation: of true and corrected rates over all windows, 0 to 1.
        excitation: root mean square of the true rate without its mean by axis, rad/s, (3,).
        windows: number of windows used.
    """

    matrix: Array
    scale: float
    rotation: Array
    correlation: float
    excitation: Array
    windows: int

    @property
    def angle_deg(self) -> float:
        """Angle of the rotation, degrees."""
        return float(np.degrees(np.linalg.norm(so3.log(self.rotation))))

    @property
    def is_determined(self) -> bool:
        """Whether the rates turn about two axes at least, so that the rotation is known."""
        sizes = np.sort(self.excitation)
        return bool(sizes[1] > _LEAST_SHARE * sizes[2])


def fit_rates(reference: Array, measured: Array) -> RateFit | None:
    """The fit of measured rates to a reference of the same times; None where there are too few or nothing turns.

    Args:
        reference: rad/s, body axes, (N, 3).
        measured: by the gyroscope, turned by its claimed mounting, (N, 3).
    """
    is_known = np.isfinite(reference).all(axis=1) & np.isfinite(measured).all(axis=1)
    if np.count_nonzero(is_known) < _FEWEST:
        return None
    kept = is_known
    for _ in range(_PASSES):
        true, seen = (rates[kept] - rates[kept].mean(axis=0) for rates in (reference, measured))
        fit = _fit_of(true, seen)
        if fit is None:
            return None
        residual = (reference - reference[kept].mean(axis=0)) - (measured - measured[kept].mean(axis=0)) @ fit.matrix.T
        sizes = np.linalg.norm(residual, axis=1)
        limit = _TRIM * _TO_SIGMA * float(np.median(sizes[is_known]))
        kept = is_known & (sizes <= max(limit, 1e-12))
        if np.count_nonzero(kept) < _FEWEST:
            return None
    return fit


def _fit_of(true: Array, seen: Array) -> RateFit | None:
    """The fit of centred rates (N, 3): scale and rotation by Kabsch, which shrink by no noise of the readings."""
    true_size, seen_size = np.linalg.norm(true), np.linalg.norm(seen)
    if true_size <= 0.0 or seen_size <= 0.0:
        return None
    left, sizes, right = np.linalg.svd(true.T @ seen)
    turn = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = left @ turn @ right
    score = float((sizes * np.diag(turn)).sum() / (true_size * seen_size))
    scale = float(true_size / seen_size)
    return RateFit(scale * rotation, scale, rotation, score, true.std(axis=0), len(true))


@dataclass(frozen=True, slots=True)
class AxesFit:
    """How well units and axes of a gyroscope explain what standing feet do.

    Attributes:
        residual: share of the changes that the readings leave as they are, median over the windows; above 1 they
            contradict the feet.
        best_unit: unit with which, and with the best axes, least is left.
        best_axes: those axes, as ``axes_matrix`` takes them.
        best_residual: what is left then.
        windows: number of windows.
    """

    residual: float
    best_unit: str
    best_axes: str
    best_residual: float
    windows: int


def axes_of_feet(feet: FeetRecord, stamps_ns: IntArray, measured: Array) -> AxesFit | None:
    """How a gyroscope fits standing feet as it is, and with which unit and axes best; None where too few stand.

    Args:
        feet: where they are.
        stamps_ns: of the gyroscope, (N,).
        measured: its rates, turned by its claimed mounting, (N, 3).
    """
    rows, changes = _windows(feet, stamps_ns, measured - np.median(measured, axis=0))
    if len(rows) < _FEWEST:
        return None
    still = float(np.median(np.linalg.norm(changes, axis=1)))
    if still <= 0.0:
        return None
    left = {
        (unit, axes): float(np.median(np.linalg.norm(changes - rows @ (factor * axes_matrix(axes)).ravel(), axis=1)))
        for unit, factor in _UNITS.items()
        for axes in _all_axes()
    }
    unit, axes = min(left, key=lambda each: left[each])
    return AxesFit(left["rad/s", "x y z"] / still, unit, axes, left[unit, axes] / still, len(rows))


def _all_axes() -> list[str]:
    """The names of the 24 rotations that turn axes into axes."""
    signed = product(permutations("xyz"), product(("", "-"), repeat=3))
    names = [" ".join(sign + axis for sign, axis in zip(signs, axes, strict=True)) for axes, signs in signed]
    return [name for name in names if np.linalg.det(axes_matrix(name)) > 0.0]


def _windows(feet: FeetRecord, stamps_ns: IntArray, measured: Array) -> tuple[Array, Array]:
    """Changes of the vector between two feet (n, 3), m, and their derivatives by the entries of M (n, 3, 9)."""
    start_ns = int(feet.stamps_ns[0])
    times_s, own_s = ((stamps - start_ns) / NS_PER_S for stamps in (feet.stamps_ns, stamps_ns))
    rows, changes = [np.zeros((0, 3, 9))], [np.zeros((0, 3))]
    if len(own_s) < 2 or len(times_s) < 2:
        return rows[0], changes[0]
    at = np.column_stack([np.interp(times_s, own_s, column) for column in measured.T])
    span = max(2, round(_WINDOW_S / float(np.median(np.diff(times_s)))))
    stands = feet.is_stance & np.isfinite(feet.position_body[:, :, 0])
    for first in range(0, len(times_s) - span, span):
        last = first + span
        if times_s[last] - times_s[first] > 2.0 * _WINDOW_S or times_s[last] > own_s[-1] or times_s[first] < own_s[0]:
            continue
        inside = slice(first, last + 1)
        standing = np.flatnonzero(stands[inside].all(axis=0))
        if len(standing) < 2:
            continue
        one = np.arange(len(standing) if len(standing) > 2 else 1)  # each foot with the next one
        other = (one + 1) % len(standing)
        places = feet.position_body[inside, standing]
        between = places[:, one] - places[:, other]  # (samples, pairs, 3)
        design = so3.hat(between)[..., None] * at[inside, None, None, None, :]  # d x w = hat(d) w
        steps_s = np.diff(times_s[inside])[:, None, None, None, None]
        integral = (0.5 * (design[1:] + design[:-1]) * steps_s).sum(axis=0)
        rows.append(integral.reshape(len(one), 3, 9))
        changes.append(between[-1] - between[0])
    return np.concatenate(rows), np.concatenate(changes)


def delay_of_feet(feet: FeetRecord, stamps_ns: IntArray, measured: Array) -> tuple[float, float] | None:
    """How late the joints' stamps are behind a gyroscope's, and its sigma, s; None where feet do not decide on it.

    The delay with which the rates leave least of what standing feet do, over all windows and over each half.

    Args:
        feet: where they are.
        stamps_ns: of the gyroscope, (N,).
        measured: its rates, turned by its mounting, (N, 3).
    """
    centred = measured - np.median(measured, axis=0)
    coarse = _best_delay(feet, stamps_ns, centred, (0.0, _LONGEST_DELAY_S, _COARSE_STEP_S))
    if coarse is None:
        return None
    near = (coarse, _COARSE_STEP_S, _FINE_STEP_S)
    best, first, second = (_best_delay(part, stamps_ns, centred, near) for part in (feet, *_halves(feet)))
    if best is None or first is None or second is None:
        return None
    return best, max(0.5 * abs(first - second), _FINE_STEP_S / 4.0)


def _halves(feet: FeetRecord) -> tuple[FeetRecord, FeetRecord]:
    middle = len(feet.stamps_ns) // 2
    parts = (slice(0, middle), slice(middle, None))
    first, second = (
        FeetRecord(feet.stamps_ns[p], feet.position_body[p], feet.is_stance[p], feet.load[p]) for p in parts
    )
    return first, second


def _best_delay(
    feet: FeetRecord, stamps_ns: IntArray, measured: Array, search: tuple[float, float, float]
) -> float | None:
    """The delay with the least residual, s; None at the border of the search or where it explains little.

    Args:
        feet: where they are.
        stamps_ns: of the gyroscope, (N,).
        measured: its rates, turned by its mounting, without their median, (N, 3).
        search: middle, reach and step, s.
    """
    middle_s, reach_s, step_s = search

    def left(delay_s: float) -> float:
        rows, changes = _windows(feet, stamps_ns + round(delay_s * NS_PER_S), measured)
        if len(rows) < _FEWEST:
            return np.inf
        still = float(np.median(np.linalg.norm(changes, axis=1)))
        own = np.linalg.norm(changes - rows @ np.eye(3).ravel(), axis=1)
        return float(np.median(own)) / still if still > 0.0 else np.inf

    delays_s = middle_s + np.arange(-reach_s, reach_s + 1e-9, step_s)
    residuals = np.array([left(delay_s) for delay_s in delays_s])
    lowest = int(np.argmin(residuals))
    if not residuals[lowest] < _EXPLAINED or lowest in (0, len(delays_s) - 1):
        return None
    before, least, after = residuals[lowest - 1 : lowest + 2]
    bend = before - 2.0 * least + after
    return float(delays_s[lowest] + (0.5 * (before - after) / bend if bend > 0.0 else 0.0) * step_s)


def turn_of_feet(feet: FeetRecord, stamps_ns: IntArray, measured: Array) -> tuple[Array, Array] | None:
    """The small rotation from a gyroscope's claimed axes to those of the feet, and its sigma, rad, (3,) each.

    Least squares over all windows without the largest residuals; the sigma is by the thirds of the recording. None
    where too few feet stand.

    Args:
        feet: where they are.
        stamps_ns: of the gyroscope, (N,).
        measured: its rates, turned by its claimed mounting, (N, 3).
    """
    rows, changes = _windows(feet, stamps_ns, measured - np.median(measured, axis=0))
    thirds = np.array_split(np.arange(len(rows)), 3)
    if min(map(len, thirds)) < _FEWEST:
        return None
    parts = np.array([_turn(rows[third], changes[third]) for third in thirds])
    return _turn(rows, changes), np.asarray(parts.std(axis=0, ddof=1) / np.sqrt(3.0))


def _turn(rows: Array, changes: Array) -> Array:
    """The rotation vector e, rad, (3,), with ``w = (I + hat(e)) m`` that leaves least of the changes."""
    generators = np.array([so3.hat(axis).ravel() for axis in np.eye(3)]).T
    design, target = rows @ generators, changes - rows @ np.eye(3).ravel()
    turn, kept = np.zeros(3), np.ones(len(rows), dtype=np.bool_)
    for _ in range(_PASSES):
        turn = np.linalg.lstsq(design[kept].reshape(-1, 3), target[kept].ravel(), rcond=None)[0]
        sizes = np.linalg.norm(target - design @ turn, axis=1)
        kept = sizes <= max(_TRIM * _TO_SIGMA * float(np.median(sizes)), 1e-12)
    return np.asarray(turn)
