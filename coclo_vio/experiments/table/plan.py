# SPDX-License-Identifier: BSD-3-Clause
"""The jobs of a table, and the settings that decide their results.

A job is one simulated recording through one variant of one mode; all jobs of a recording are one unit of work, so that
its images are read while they are cached and no two workers simulate the same trial.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from coclo_vio import __version__
from coclo_vio.experiments.table.table_record import Fingerprint
from coclo_vio.fusion.config import BridgeConfig
from coclo_vio.fusion.feedback import feedback_policies
from coclo_vio.robot.description import urdf_path
from coclo_vio.runs.modes.registry import mode_of, modes
from coclo_vio.runs.run_config import RunConfig, resolve
from coclo_vio.simulation.simulated_recording import IDEAL_ROBOT, SIMULATED_ROBOT, SimulationConfig, simulation_config
from coclo_vio.simulation.trial.terrain import TERRAINS, TerrainName
from coclo_vio.values.errors import ConfigError, listing

JPEG: Mapping[str, Any] = {"camera": {"encoding": "jpeg"}}  # a third as large as PNG, slightly harder to track


def default_modes() -> tuple[str, ...]:
    """The modes that declare themselves as part of the table."""
    return tuple(mode.name for mode in modes().values() if mode.table)


@dataclass(frozen=True, slots=True)
class Variant:
    """A mode, with another feedback policy than the configured one where it is given.

    Attributes:
        mode: its name.
        feedback: name of a feedback policy; None for the configured one.
    """

    mode: str
    feedback: str | None = None

    @property
    def name(self) -> str:
        """Mode and policy, such as ``combined:ci``, or the mode alone."""
        return self.mode if self.feedback is None else f"{self.mode}:{self.feedback}"

    @property
    def file_name(self) -> str:
        """The name without a colon, which not every file system allows."""
        return self.name.replace(":", "-")

    @property
    def trajectories(self) -> tuple[str, ...]:
        """Names of its trajectories."""
        return mode_of(self.mode).trajectory_names

    def configured(self, config: RunConfig) -> RunConfig:
        """The configuration of this variant."""
        if self.feedback is None:
            return config
        bridge = BridgeConfig.parse({**config.bridge.model_dump(), "feedback": self.feedback}, self.name)
        return config.model_copy(update={"bridge": bridge})


@dataclass(frozen=True, slots=True)
class Job:
    """One recording through one variant."""

    trial: TerrainName
    seed: int
    variant: Variant

    @property
    def recording(self) -> str:
        """Name of the recording."""
        return f"{self.trial}_{self.seed}"

    @property
    def name(self) -> str:
        """Name of the job and of its file."""
        return f"{self.recording}_{self.variant.file_name}"


@dataclass(frozen=True, slots=True)
class TablePlan:
    """Everything that decides the content of a table.

    Attributes:
        config: of the estimators.
        seeds: how many.
        first_seed: the first of them; the others follow.
        trials: names of the terrains.
        modes: their names.
        policy_seeds: for this many of the seeds, modes with feedback are run with every other feedback policy too.
        ideal: whether the robot is exactly as described.
        simulation: changes to the trials beyond the paper's and JPEG images.
        images: whether the cameras record.
        until_s: trials end after this long, s; None for whole trials.
        commit: of the code, where results of different commits are kept apart.
    """

    config: RunConfig = field(default_factory=lambda: resolve(SIMULATED_ROBOT))
    seeds: int = 10
    first_seed: int = 11
    trials: tuple[TerrainName, ...] = TERRAINS
    modes: tuple[str, ...] = field(default_factory=default_modes)
    policy_seeds: int = 3
    ideal: bool = False
    simulation: Mapping[str, Any] = field(default_factory=dict)
    images: bool = True
    until_s: float | None = None
    commit: str = ""

    @property
    def variants(self) -> tuple[Variant, ...]:
        """The modes as they are configured."""
        return tuple(Variant(mode) for mode in self.modes)

    @property
    def policies(self) -> tuple[Variant, ...]:
        """The modes with feedback, each with every feedback policy; none without seeds for them."""
        configured = self.config.bridge.feedback
        return tuple(
            Variant(mode, None if policy == configured else policy)
            for mode in (self.modes if self.policy_seeds else ())
            if mode_of(mode).has_feedback
            for policy in feedback_policies()
        )

    def policy_of(self, variant: Variant) -> str:
        """The feedback policy of a variant."""
        return variant.feedback or self.config.bridge.feedback

    def jobs(self) -> Iterator[Job]:
        """All jobs in the order of work: those of one recording together, and all trials of a seed."""
        for number, seed in enumerate(range(self.first_seed, self.first_seed + self.seeds)):
            more = self.policies if number < self.policy_seeds else ()
            variants = dict.fromkeys((*self.variants, *more))
            for trial in self.trials:
                yield from (Job(trial, seed, variant) for variant in variants)

    def simulation_of(self, trial: TerrainName) -> SimulationConfig:
        """How the recordings of a trial are simulated."""
        return simulation_config(trial, JPEG, IDEAL_ROBOT if self.ideal else {}, self.simulation)

    def fingerprint(self, job: Job) -> Fingerprint:
        """What decides the result of a job."""
        simulated = [self.simulation_of(job.trial).model_dump(mode="json"), self.images, self.until_s]
        return Fingerprint(
            version=__version__,
            configuration=_digest(_plain(job.variant.configured(self.config))),
            simulation=_digest(simulated),
            ideal=self.ideal,
            trial=job.trial,
            seed=job.seed,
            variant=job.variant.name,
            commit=self.commit,
        )


def _plain(config: RunConfig) -> dict[str, Any]:
    """A configuration as plain values, with a digest of the robot's URDF instead of its path."""
    values: dict[str, Any] = config.model_dump(mode="json")
    if config.robot is not None:
        values["robot"]["urdf"] = hashlib.sha256(urdf_path(config.robot).read_bytes()).hexdigest()
    return values


def checked_trials(names: Sequence[str]) -> tuple[TerrainName, ...]:
    """The trials of these names, each once.

    Raises:
        ConfigError: no name, or one that no trial has.
    """
    unknown = [name for name in names if name not in TERRAINS]
    if unknown or not names:
        raise ConfigError(
            f"--trials {','.join(names)!r}: choose some of {listing(TERRAINS)}, separated by commas, or leave it out"
        )
    return tuple(name for name in TERRAINS if name in names)


def checked_modes(names: Sequence[str]) -> tuple[str, ...]:
    """The modes of these names, each once.

    Raises:
        ConfigError: no name, or one that no mode has.
    """
    if not names:
        raise ConfigError(f"--modes names no mode; leave it out for {', '.join(default_modes())}")
    for name in names:
        mode_of(name)
    return tuple(dict.fromkeys(names))


def _digest(values: Any) -> str:
    text = json.dumps(values, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:16]
