# SPDX-License-Identifier: BSD-3-Clause
"""Writes the estimates of a trajectory into a run folder as they come, sixteen or a quarter of a second at a time."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from coclo_vio.runs.line_file import LineFile
from coclo_vio.values.arrays import Array
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.trajectory import tum_lines
from coclo_vio.values.units import NS_PER_S

UPPER = [(row, column) for row in range(6) for column in range(row, 6)]
"""Rows and columns of the upper triangle of a pose covariance, in the order of the state file."""
VECTORS = ("velocity_world", "angular_velocity_body", "gyroscope_bias", "accelerometer_bias")
"""Fields of ``NavState`` that the state file has, with three columns each."""
STATE_COLUMNS = (
    "stamp_ns",
    *(f"{name}_{axis}" for name in VECTORS for axis in "xyz"),
    *(f"pose_covariance_{row}{column}" for row, column in UPPER),
)
"""Columns of the state file, but those of the legs."""
_UPPER_ROWS, _UPPER_COLUMNS = np.triu_indices(6)
_ROWS_AT_ONCE = 16  # a run that is killed loses fewer than these
_LONGEST_HELD_NS = NS_PER_S // 4  # ... nor more than this, where estimates come at the rate of images


class StateWriter:
    """Writes ``<estimator>.tum`` and ``<estimator>_state.csv``, a line for each estimate, at most 16 lines at once.

    The state file has, per stamp (ns): velocity (m/s, world), angular velocity (rad/s, body), gyroscope and
    accelerometer bias (body), the upper triangle of the 6x6 pose covariance (right/local, rotation first), and, where
    the first estimate has feet, each leg's contact probability and stance.
    """

    def __init__(
        self, folder: Path, estimator: str, leg_names: tuple[str, ...], sizes: tuple[int, int] = (0, 0)
    ) -> None:
        """Open both files.

        Args:
            folder: of the run.
            estimator: name of the trajectory.
            leg_names: of the robot.
            sizes: go on after so many bytes of both files; they begin anew with 0.

        Raises:
            OSError: a file cannot be written.
            DatasetError: a file has fewer bytes.
        """
        self._tum = LineFile(folder / f"{estimator}.tum", sizes[0])
        self._state = LineFile(folder / f"{estimator}_state.csv", sizes[1])
        self._leg_names = leg_names
        self._has_header = sizes[1] > 0
        self._held: list[StateEstimate] = []

    @property
    def sizes(self) -> tuple[int, int]:
        """Bytes of both files."""
        return self._tum.size, self._state.size

    def write(self, estimate: StateEstimate) -> None:
        """Append one estimate to both files."""
        self._held.append(estimate)
        if len(self._held) == _ROWS_AT_ONCE or estimate.stamp_ns - self._held[0].stamp_ns >= _LONGEST_HELD_NS:
            self.flush()

    def close(self) -> None:
        """Write what is held, and close both files.

        Raises:
            OSError: it cannot be written; the files are closed all the same.
        """
        try:
            self.flush()
            if not self._has_header:
                self._write_header(has_feet=False)
        finally:
            self._tum.close()
            self._state.close()

    def flush(self) -> None:
        """Hand the estimates that are held to the operating system."""
        held, self._held = self._held, []
        if not held:
            return
        if not self._has_header:
            self._write_header(has_feet=held[0].feet is not None)
        stamps_ns = [estimate.stamp_ns for estimate in held]
        poses = np.array([estimate.nav.T_world_body for estimate in held])
        lines = []
        for estimate, row in zip(held, _state_rows(held).tolist(), strict=True):
            feet = estimate.feet
            if feet is not None:
                contacts = zip(feet.contact_probability.tolist(), feet.is_stance.tolist(), strict=True)
                row += [value for contact in contacts for value in contact]
            lines.append(f"{estimate.stamp_ns},{','.join(['%.9g'] * len(row)) % tuple(row)}\n")
        self._tum.append(list(tum_lines(stamps_ns, poses)))
        self._state.append(lines)

    def _write_header(self, *, has_feet: bool) -> None:
        legs = self._leg_names if has_feet else ()
        feet = (f"{leg}.{what}" for leg in legs for what in ("contact_probability", "is_stance"))
        self._state.append([",".join([*STATE_COLUMNS, *feet]) + "\n"])
        self._has_header = True


def _state_rows(estimates: Sequence[StateEstimate]) -> Array:
    """What the state file has of each estimate but the feet, (n, 33)."""
    vectors = [np.array([getattr(estimate.nav, name) for estimate in estimates]) for name in VECTORS]
    covariance = np.array([estimate.covariance for estimate in estimates])
    return np.concatenate((*vectors, covariance[:, _UPPER_ROWS, _UPPER_COLUMNS]), axis=1)
