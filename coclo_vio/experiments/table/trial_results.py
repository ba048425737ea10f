# SPDX-License-Identifier: BSD-3-Clause
"""Rows of finished jobs as figures by trial, seed, variant and estimator."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from coclo_vio.experiments.table.job_store import Row

FIGURES = (
    "drift_percent",
    "rpe_1m_percent",
    "paper_drift_percent",
    "ate_m",
    "anees_pose",
    "velocity_rmse_mps",
    "yaw_drift_deg",
)
ERRORS: Mapping[str, str] = {"drift": "drift_percent", "rpe": "rpe_1m_percent"}  # what wins are counted by


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """What one estimator did with one recording.

    Attributes:
        trial: name of the ground.
        seed: of the trial.
        variant: name of the variant.
        estimator: its name.
        told: its part of the job's row.
    """

    trial: str
    seed: int
    variant: str
    estimator: str
    told: Mapping[str, Any]

    @property
    def failure(self) -> str | None:
        """Why it came to nothing, or stopped early."""
        reason = self.told["failure"]
        return None if reason is None else str(reason)

    def figure(self, reference: str, key: str) -> float | None:
        """A figure against a reference; yaw by its size. None of one that failed, even where it got some way."""
        block = self.told[reference]
        if self.failure is not None or block is None or block[key] is None:
            return None
        return abs(float(block[key])) if key == "yaw_drift_deg" else float(block[key])

    @property
    def realtime_factor(self) -> float | None:
        """Seconds of recording a second of computing; None of one that failed."""
        value = self.told["realtime_factor"]
        return None if self.failure is not None or value is None else float(value)


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """All of a table."""

    every: tuple[Result, ...]

    @classmethod
    def of(cls, rows: Iterable[Row]) -> "Results":
        """The results in rows of jobs."""
        return cls(
            tuple(
                Result(row["trial"], row["seed"], row["variant"], name, told)
                for row in rows
                for name, told in row["estimators"].items()
            )
        )

    def by_seed(self, trial: str, estimator: str, variant: str | None = None) -> dict[int, Result]:
        """Those of one estimator on one ground; of the variant that is named as its mode if none is given."""
        return {
            one.seed: one
            for one in self.every
            if one.trial == trial
            and one.estimator == estimator
            and (one.variant == variant if variant is not None else ":" not in one.variant)
        }

    @property
    def trials(self) -> tuple[str, ...]:
        """The grounds, in the order of the work."""
        return tuple(dict.fromkeys(one.trial for one in self.every))

    @property
    def estimators(self) -> tuple[str, ...]:
        """The estimators as they are configured: what tells a separate one comes before what is combined."""
        names = dict.fromkeys(one.estimator for one in self.every if ":" not in one.variant)
        return tuple(sorted(names, key=lambda name: name.startswith("combined")))
