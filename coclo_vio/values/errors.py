# SPDX-License-Identifier: BSD-3-Clause
"""The errors of the package: one base, one class for each part that can be at fault.

A message names the value, the limit, the choices, and the next step. A rejected measurement is a result, never an
error.
"""

from collections.abc import Iterable

_LONGEST_NAME = 120


class CocloError(Exception):
    """Base of every error raised on purpose by this package."""


class ConfigError(CocloError):
    """A configuration value, key or preset is wrong."""


class DatasetError(CocloError):
    """A recording cannot be read as requested."""


class TopicNotFound(DatasetError):  # noqa: N818 -- a condition, as in "topic not found"
    """A recording has no such column, topic or file."""


class TimestampError(DatasetError):
    """Time stamps are missing, not monotonic or not usable."""


class CalibrationMissing(DatasetError):  # noqa: N818
    """A recording lacks a calibration that the mode needs."""


class RobotModelError(CocloError):
    """A robot description names links or joints that its URDF does not have."""


class FilterError(CocloError):
    """The filter cannot start or continue."""


class SmootherError(CocloError):
    """The sliding-window smoother or a GTSAM baseline cannot start or continue."""


class SimulationError(CocloError):
    """A trial cannot be simulated: the robot fell, or the simulator is not installed."""


class EvaluationError(CocloError):
    """Two trajectories cannot be compared."""


def listing(choices: Iterable[str], most: int = 40) -> str:
    """Names in alphabetical order for an error message, at most ``most`` of them."""
    names = sorted(shortened(choice, _LONGEST_NAME) for choice in choices)
    shown = ", ".join(names[:most]) if names else "none"
    return shown if len(names) <= most else f"{shown}, ... ({len(names)} in all)"


def shortened(text: object, most: int = 200) -> str:
    """A value as text for an error message: one line of at most about ``most`` characters."""
    line = " ".join(str(text).split())
    return line if len(line) <= most else f"{line[:most]} ... ({len(line)} characters)"


def interrupt_in(error: BaseException) -> BaseException | None:
    """What a signal raised, where an error is that or came of it; None where it is an error of its own.

    An interrupt that reaches code compiled by numba comes out of it as the cause of a ``SystemError``.
    """
    cause: BaseException | None = error
    while cause is not None and isinstance(cause, Exception):
        cause = cause.__cause__
    return cause
