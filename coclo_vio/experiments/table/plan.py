# SPDX-License-Identifier: BSD-3-Clause
"""What there is to do for a table: jobs, and the settings that decide what comes out of them.

A job is one simulated recording through one variant of one mode; all jobs of a recording are one unit of work, so that
its images are read while they are warm and no two workers simulate the same trial.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, get_args

from coclo_vio import __version__
from coclo_vio.fusion.bridge import BridgeConfig, Policy
from coclo_vio.fusion.combined import BY_EYES, BY_LEGS
from coclo_vio.robot.description import urdf_path
from coclo_vio.runs.estimators import estimator_kind
from coclo_vio.runs.run_config import RunConfig, resolve
from coclo_vio.simulation.simulated_recording import IDEAL_ROBOT, SIMULATED_ROBOT, SimulationConfig, simulation_config
from coclo_vio.simulation.trial.terrain import TERRAINS, TerrainName
from coclo_vio.values.errors import ConfigError, listing

JPEG: Mapping[str, Any] = {"camera": {"encoding": "jpeg"}}  # a third as large as PNG, a little harder to see with
COMBINED = "combined"
DEFAULT_MODES = ("coclo", "vins", COMBINED)
POLICIES: tuple[str, ...] = get_args(get_args(Policy)[0])


@dataclass(frozen=True, slots=True)
class Variant:
    """A mode, and of the combined one the policy of its feedback where it is another than the configured one.

    Attributes:
        mode: name of the estimator.
        feedback: one of ``POLICIES``; None for the configured one.
    """

    mode: str
    feedback: str | None = None

    @property
    def name(self) -> str:
        """``combined:ci``, or the mode alone."""
        return self.mode if self.feedback is None else f"{self.mode}:{self.feedback}"

    @property
    def file_name(self) -> str:
        """The name without a colon, which not every file system has."""
        return self.name.replace(":", "-")

    @property
    def estimators(self) -> tuple[str, ...]:
        """Names of the trajectories that come out of it."""
        return (BY_LEGS, BY_EYES) if self.mode == COMBINED else (self.mode,)

    def configured(self, config: RunConfig) -> RunConfig:
        """The configuration that this variant runs with."""
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
    """Everything that decides what is in a table.

    Attributes:
        config: of the estimators.
        seeds: how many.
        first_seed: the first of them; the others follow.
        trials: the grounds.
        modes: the estimators.
        policy_seeds: with so many of the seeds the combined mode is run with every other feedback policy too.
        ideal: whether the robot is exactly as described.
        simulation: changes to the trials beyond the paper's and JPEG images.
        images: whether the cameras record.
        until_s: trials are cut short after so many seconds.
    """

    config: RunConfig = field(default_factory=lambda: resolve(SIMULATED_ROBOT))
    seeds: int = 10
    first_seed: int = 11
    trials: tuple[TerrainName, ...] = TERRAINS
    modes: tuple[str, ...] = DEFAULT_MODES
    policy_seeds: int = 3
    ideal: bool = False
    simulation: Mapping[str, Any] = field(default_factory=dict)
    images: bool = True
    until_s: float | None = None

    @property
    def variants(self) -> tuple[Variant, ...]:
        """The modes as they are configured."""
        return tuple(Variant(mode) for mode in self.modes)

    @property
    def policies(self) -> tuple[Variant, ...]:
        """The combined mode with every feedback policy, in the order of ``POLICIES``; none where nobody asks."""
        if COMBINED not in self.modes or not self.policy_seeds:
            return ()
        own = self.config.bridge.feedback
        return tuple(Variant(COMBINED, None if policy == own else policy) for policy in POLICIES)

    def policy_of(self, variant: Variant) -> str:
        """The feedback policy that a combined variant runs with."""
        return variant.feedback or self.config.bridge.feedback

    def jobs(self) -> Iterator[Job]:
        """All jobs in the order of work: those of one recording together, and all grounds of a seed."""
        for number, seed in enumerate(range(self.first_seed, self.first_seed + self.seeds)):
            more = self.policies if number < self.policy_seeds else ()
            variants = dict.fromkeys((*self.variants, *more))
            for trial in self.trials:
                yield from (Job(trial, seed, variant) for variant in variants)

    def simulation_of(self, trial: TerrainName) -> SimulationConfig:
        """How the recordings of a trial are simulated."""
        return simulation_config(trial, JPEG, IDEAL_ROBOT if self.ideal else {}, self.simulation)

    def fingerprint(self, job: Job) -> dict[str, Any]:
        """What decides the result of a job; another fingerprint is another result."""
        simulated = [self.simulation_of(job.trial).model_dump(mode="json"), self.images, self.until_s]
        return {
            "version": __version__,
            "configuration": _digest(_told(job.variant.configured(self.config))),
            "simulation": _digest(simulated),
            "ideal": self.ideal,
            "trial": job.trial,
            "seed": job.seed,
            "variant": job.variant.name,
        }


def _told(config: RunConfig) -> dict[str, Any]:
    """A configuration as plain values, with what the robot's URDF says instead of where it stands."""
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
            f"--trials {','.join(names)!r}: give some of {listing(TERRAINS)}, separated by commas, or leave it out"
        )
    return tuple(name for name in TERRAINS if name in names)


def checked_modes(names: Sequence[str]) -> tuple[str, ...]:
    """The modes of these names, each once.

    Raises:
        ConfigError: no name, or one that no mode has.
    """
    if not names:
        raise ConfigError(f"--modes names no estimator; leave it out for {', '.join(DEFAULT_MODES)}")
    for name in names:
        estimator_kind(name)
    return tuple(dict.fromkeys(names))


def _digest(values: Any) -> str:
    text = json.dumps(values, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()[:16]
