# SPDX-License-Identifier: BSD-3-Clause
"""Records of finished jobs as figures by trial, seed, variant and trajectory."""

from collections.abc import Iterable
from dataclasses import dataclass

from coclo_vio.evaluation.trajectory_roles import is_fused
from coclo_vio.experiments.table.table_record import FigureSpreads, JobRecord, JobTrajectory, Reference

FIGURES = tuple(FigureSpreads.model_fields)
DRIFT, RPE = "drift_percent", "rpe_1m_percent"
"""The errors by which trajectories are compared."""


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """One trajectory on one recording.

    Attributes:
        trial: name of the terrain.
        seed: of the trial.
        variant: name of the variant.
        name: of the trajectory.
        record: its part of the job's record.
    """

    trial: str
    seed: int
    variant: str
    name: str
    record: JobTrajectory

    @property
    def failure(self) -> str | None:
        """Why there is no result, or not all of it."""
        return self.record.failure

    def figure(self, reference: Reference, key: str) -> float | None:
        """A figure against a reference; yaw by its size. None where the trajectory failed, even if it has poses."""
        evaluation = self.record.against(reference)
        value = None if self.failure is not None or evaluation is None else getattr(evaluation, key)
        if value is None:
            return None
        return abs(float(value)) if key == "yaw_drift_deg" else float(value)

    @property
    def realtime_factor(self) -> float | None:
        """Seconds of recording a second of computing; None where the trajectory failed."""
        return None if self.failure is not None else self.record.realtime_factor


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """All of a table."""

    every: tuple[Result, ...]

    @classmethod
    def of(cls, jobs: Iterable[JobRecord]) -> "Results":
        """The results in records of jobs."""
        return cls(
            tuple(
                Result(job.trial, job.seed, job.variant, name, trajectory)
                for job in jobs
                for name, trajectory in job.estimators.items()
            )
        )

    def by_seed(self, trial: str, name: str, variant: str | None = None) -> dict[int, Result]:
        """Those of one trajectory on one terrain; of the variant that is named as its mode if none is given."""
        return {
            result.seed: result
            for result in self.every
            if result.trial == trial
            and result.name == name
            and (result.variant == variant if variant is not None else ":" not in result.variant)
        }

    @property
    def trials(self) -> tuple[str, ...]:
        """The terrains, in the order of the work."""
        return tuple(dict.fromkeys(result.trial for result in self.every))

    @property
    def names(self) -> tuple[str, ...]:
        """The trajectories of the configured variants, standalone ones before fused ones."""
        names = dict.fromkeys(result.name for result in self.every if ":" not in result.variant)
        return tuple(sorted(names, key=is_fused))
