# SPDX-License-Identifier: BSD-3-Clause
"""From the load on a foot, or from its motion, to contact: a probability and a decision for each leg.

The load comes from a foot sensor or from joint torques (``FootLoad``), the motion from joints and IMU (``FootMotion``);
the filter uses the resulting ``ContactState``. Contact estimators are registered by name; ``contact.method`` of the
configuration chooses one.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, Protocol, Self, runtime_checkable

import numpy as np
from pydantic import Field, model_validator

from coclo_vio.robot.contact_probability import logistic_probability, paper_probability
from coclo_vio.robot.foot_motion import FootMotion
from coclo_vio.robot.kinematic_contact import KinematicContact, KinematicContactConfig
from coclo_vio.values.arrays import Array, BoolArray, has_nan
from coclo_vio.values.config import StageConfig
from coclo_vio.values.errors import ConfigError, listing
from coclo_vio.values.units import NS_PER_S

_OF_LOAD = ("paper", "logistic", "hysteresis")
_OF_MOTION = ("kinematic", "kinematic_load")


class ContactConfig(StageConfig):
    """How the load on a foot becomes contact. Forces are in N, or in the raw counts of a foot sensor."""

    source: Annotated[
        Literal["torque", "force_sensor", "kinematic"],
        Field(description="where the load comes from; kinematic: from nowhere, contact is by the motion of the feet"),
    ] = "torque"
    method: Annotated[
        str,
        Field(
            description="contact estimator: paper, logistic, hysteresis, kinematic, kinematic_load, or the name of a "
            "registered one"
        ),
    ] = "hysteresis"
    kinematic: Annotated[KinematicContactConfig, Field(description="contact by the motion of the feet")] = (
        KinematicContactConfig()
    )
    parameters: dict[str, float] = Field(
        default_factory=dict, description="parameters of a registered contact estimator, by name"
    )
    compensation: Annotated[
        Literal["none", "gravity", "inertia"],
        Field(description="which part of the leg's own dynamics is compensated in the joint torques"),
    ] = "gravity"
    on_force: Annotated[float, Field(gt=0, description="load from which a swing foot is in stance, N or counts")] = 20.0
    off_force: Annotated[float, Field(ge=0, description="load below which a stance foot swings, N or counts")] = 12.0
    on_dwell_s: Annotated[float, Field(ge=0, le=1, description="time above on_force before stance, s")] = 0.0
    off_dwell_s: Annotated[float, Field(ge=0, le=1, description="time below off_force before swing, s")] = 0.0
    unloaded_force: Annotated[
        float | None,
        Field(
            gt=0,
            description="beside a force sensor: a foot lifts off where its load by joint torques falls below this, N; "
            "null: torques are not used",
        ),
    ] = None
    logistic_centre: Annotated[
        float | None, Field(description="load of probability 0.5, N or counts; null: midway between off and on")
    ] = None
    logistic_width: Annotated[
        float | None,
        Field(gt=0, description="load over which the odds grow by e, N or counts; null: a quarter of on - off"),
    ] = None
    max_force: Annotated[
        float | None, Field(gt=0, description="the paper's |Fmax| of a stance foot, N or counts; null: span = on + off")
    ] = None
    min_force: Annotated[float | None, Field(ge=0, description="the paper's |Fmin| of a stance foot, N or counts")] = (
        None
    )
    stance_probability: Annotated[
        float, Field(gt=0, lt=1, description="probability from which a foot is in stance (paper and logistic)")
    ] = 0.5

    @model_validator(mode="after")
    def _estimator_is_registered(self) -> Self:
        try:
            _registered(self.method).check(self.parameters)
        except ConfigError as error:  # pydantic adds where it is
            raise ValueError(str(error)) from error
        return self

    @model_validator(mode="after")
    def _forces_are_in_order(self) -> Self:
        if self.off_force >= self.on_force:
            raise ValueError(f"off_force = {self.off_force} must lie below on_force = {self.on_force}")
        if (self.max_force is None) != (self.min_force is None):
            raise ValueError("max_force and min_force are recorded together; set both or neither")
        if self.max_force is not None and self.min_force is not None and self.min_force >= self.max_force:
            raise ValueError(f"min_force = {self.min_force} must lie below max_force = {self.max_force}")
        return self

    @property
    def estimator(self) -> str:
        """The contact estimator that is used: without a load ``kinematic`` instead of those that have nothing else."""
        return "kinematic" if self.source == "kinematic" and self.method in _OF_LOAD else self.method

    @property
    def uses_motion(self) -> bool:
        """Whether one of the estimators by the motion of the feet is used."""
        return self.estimator in _OF_MOTION

    @property
    def needs_load(self) -> bool:
        """Whether contact is by the load alone, with an estimator of this package."""
        return self.estimator in _OF_LOAD

    def by_load(self) -> Self:
        """The same by hysteresis of the load where contact is by motion, for whoever knows the load alone."""
        return self.model_copy(update={"method": "hysteresis"}) if self.uses_motion else self

    def for_paper(self) -> Self:
        """The same by the paper's measure of contact, |F| / (|Fmax| - |Fmin|), unless contact is by motion."""
        if self.uses_motion:
            return self
        return self.model_copy(
            update={"method": "paper", "parameters": {}, "compensation": "none", "unloaded_force": None}
        )

    @property
    def centre(self) -> float:
        """Load at which the logistic form gives 0.5, N or counts."""
        middle = 0.5 * (self.on_force + self.off_force)
        return middle if self.logistic_centre is None else self.logistic_centre

    @property
    def width(self) -> float:
        """Load over which the odds of the logistic form grow by e, N or counts."""
        return 0.25 * (self.on_force - self.off_force) if self.logistic_width is None else self.logistic_width

    @property
    def span(self) -> float:
        """The paper's ``|Fmax| - |Fmin|``; without these two on + off, which puts 0.5 midway between on and off."""
        if self.max_force is None or self.min_force is None:
            return self.on_force + self.off_force
        return self.max_force - self.min_force


@dataclass(frozen=True, slots=True, eq=False)
class ContactState:
    """Contact of every leg at one time, in the order of the robot's legs.

    Attributes:
        probability: in 0..1, (legs,); 0 where the load is unknown.
        is_stance: the decision, (legs,).
        load: as measured, N or counts, (legs,); NaN where unknown.
    """

    probability: Array
    is_stance: BoolArray
    load: Array


class ContactEstimator(Protocol):
    """Decides which feet are in stance, one sample after the other."""

    def update(self, stamp_ns: int, load: Array) -> ContactState:
        """The contact of every leg at a stamp.

        Args:
            stamp_ns: time in nanoseconds, never before the last one.
            load: on each foot, N or counts, (legs,); NaN where unknown: such a leg has probability 0 and is in swing.
        """


@runtime_checkable
class UsesMotion(Protocol):
    """A contact estimator that uses the motion of the feet too."""

    def observe(self, motion: FootMotion) -> None:
        """Take the motion at a joint sample; ``update`` follows with the load at the same stamp."""


ContactFactory = Callable[[ContactConfig, int], ContactEstimator]
"""From the configuration and the number of legs to a fresh estimator."""


@dataclass(frozen=True, slots=True)
class _Registration:
    name: str
    factory: ContactFactory
    description: str
    parameters: tuple[str, ...]

    def check(self, given: Mapping[str, float]) -> None:
        unknown = set(given) - set(self.parameters)
        if unknown and not self.parameters:
            raise ConfigError(
                f"the contact estimator {self.name!r} takes no parameters, but {listing(unknown)} is given; remove it "
                "from `parameters`, or name it in register_contact_estimator(parameters=...) of an own estimator"
            )
        if unknown:
            raise ConfigError(
                f"the contact estimator {self.name!r} has no parameter {listing(unknown)}; it has: "
                f"{listing(self.parameters)}"
            )


_REGISTERED: dict[str, _Registration] = {}


def register_contact_estimator(
    name: str, factory: ContactFactory, description: str, *, parameters: Iterable[str] = ()
) -> None:
    """Make a contact estimator available as ``contact.method``.

    Args:
        name: value of ``contact.method`` that chooses it.
        factory: makes a fresh one from the configuration and the number of legs.
        description: of its rule, in one line.
        parameters: names that ``contact.parameters`` may hold; the factory reads them from the configuration.

    Raises:
        ConfigError: another estimator has this name.
    """
    new = _Registration(name, factory, description, tuple(parameters))
    if _REGISTERED.setdefault(name, new) != new:
        raise ConfigError(
            f"a contact estimator named {name!r} is registered already: {_REGISTERED[name].description}; choose "
            "another name"
        )


def unregister_contact_estimator(name: str) -> None:
    """Remove a contact estimator, if there is one of this name."""
    _REGISTERED.pop(name, None)


def contact_estimators() -> Mapping[str, str]:
    """The description of each registered contact estimator, by name."""
    return {name: registration.description for name, registration in _REGISTERED.items()}


def _registered(name: str) -> _Registration:
    if name not in _REGISTERED:
        raise ConfigError(
            f"there is no contact estimator {name!r}; there are: {listing(_REGISTERED)}; an own one has to be "
            "registered first, by register_contact_estimator()"
        )
    return _REGISTERED[name]


class ContactDetector:
    """The configured contact estimator, guarded against stamps that go backwards.

    A load of NaN is counted; a stamp before the last one changes nothing and is counted.

    Raises:
        ConfigError: the estimator is not registered any more, or returns another number of legs than the robot has.
    """

    def __init__(self, config: ContactConfig, legs: int) -> None:
        self.config = config
        self._estimator = _registered(config.estimator).factory(config, legs)
        self._motion_estimator = self._estimator if isinstance(self._estimator, UsesMotion) else None
        self._legs = legs
        self._stamp_ns: int | None = None
        self._state = ContactState(np.zeros(legs), np.zeros(legs, dtype=np.bool_), np.full(legs, np.nan))
        self._counts = {"contact_load_missing": 0, "contact_stamp_backwards": 0}

    @property
    def counts(self) -> Mapping[str, int]:
        """Loads that were NaN, and samples refused for their stamp."""
        return self._counts

    def update(self, stamp_ns: int, load: Array, motion: FootMotion | None = None) -> ContactState:
        """Take loads and motion of the feet; returns the contact of every leg then.

        Args:
            stamp_ns: time in nanoseconds.
            load: on each foot, N or counts, (legs,); NaN where unknown.
            motion: of the feet at that time, for estimators that use it.
        """
        if self._stamp_ns is not None and stamp_ns < self._stamp_ns:
            self._counts["contact_stamp_backwards"] += 1
            return self._state
        self._stamp_ns = stamp_ns
        if motion is not None and self._motion_estimator is not None:
            self._motion_estimator.observe(motion)
        if self.config.source != "kinematic" and has_nan(load):
            self._counts["contact_load_missing"] += int(np.isnan(load).sum())
        self._state = self._estimator.update(stamp_ns, load)
        for name, values in (("probability", self._state.probability), ("is_stance", self._state.is_stance)):
            if np.shape(values) != (self._legs,):
                raise ConfigError(
                    f"contact estimator {self.config.estimator!r}: {name} has shape {np.shape(values)}, but the robot "
                    f"has {self._legs} legs; return one value for each leg, shape ({self._legs},)"
                )
        return self._state


class _ProbabilityThreshold:
    """Stance from ``stance_probability`` on, without memory."""

    def __init__(self, config: ContactConfig, probability: Callable[[Array], Array]) -> None:
        self._config, self._probability = config, probability

    def update(self, stamp_ns: int, load: Array) -> ContactState:
        probability = self._probability(_without_nan(load))
        return ContactState(probability, probability >= self._config.stance_probability, load)


class _Hysteresis:
    """A Schmitt trigger with dwell times; every foot starts in swing, and a load of NaN ends stance at once."""

    def __init__(self, config: ContactConfig, legs: int) -> None:
        self._config = config
        self._on_dwell_ns = round(config.on_dwell_s * NS_PER_S)
        self._off_dwell_ns = round(config.off_dwell_s * NS_PER_S)
        self._is_stance: BoolArray = np.zeros(legs, dtype=np.bool_)
        self._since_ns = np.zeros(legs, dtype=np.int64)
        self._is_changing: BoolArray = np.zeros(legs, dtype=np.bool_)

    def update(self, stamp_ns: int, load: Array) -> ContactState:
        """One step of the trigger; a change takes effect once its condition has held for the dwell time."""
        config, known = self._config, _without_nan(load)
        probability = logistic_probability(known, config.centre, config.width)
        has_condition = np.where(self._is_stance, known < config.off_force, known >= config.on_force)
        if not has_condition.any():
            self._is_changing = has_condition
            return ContactState(probability, self._is_stance, load)
        self._since_ns = np.where(has_condition & self._is_changing, self._since_ns, stamp_ns)
        dwell_ns = np.where(self._is_stance, self._off_dwell_ns, self._on_dwell_ns)
        changes = has_condition & ((stamp_ns - self._since_ns >= dwell_ns) | np.isnan(load))
        self._is_stance = self._is_stance ^ changes
        self._is_changing = has_condition & ~changes
        return ContactState(probability, self._is_stance, load)


class _Kinematic:
    """Stance by the motion of the feet, from ``on_probability`` until below ``off_probability``."""

    def __init__(self, config: ContactConfig, legs: int, *, weighs_load: bool) -> None:
        self._config, self._weighs_load = config, weighs_load
        self._contact = KinematicContact(config.kinematic, legs)
        self._motion: FootMotion | None = None
        self._is_stance: BoolArray = np.zeros(legs, dtype=np.bool_)

    def observe(self, motion: FootMotion) -> None:
        """Keep the motion for ``update``."""
        self._motion = motion

    def update(self, stamp_ns: int, load: Array) -> ContactState:
        """One step; without motion at this stamp no foot is in stance."""
        motion, kinematic = self._motion, self._config.kinematic
        if motion is None or motion.stamp_ns != stamp_ns:
            return ContactState(np.zeros(len(load)), np.zeros(len(load), dtype=np.bool_), load)
        odds = None
        if self._weighs_load:
            limit = kinematic.load_limit
            odds = np.clip(np.nan_to_num((load - self._config.centre) / self._config.width), -limit, limit)
        probability = self._contact.update(motion, odds)
        limits = np.where(self._is_stance, kinematic.off_probability, kinematic.on_probability)
        self._is_stance = probability >= limits
        return ContactState(probability, self._is_stance, load)


def _without_nan(load: Array) -> Array:
    return np.where(np.isnan(load), -np.inf, load) if has_nan(load) else load


register_contact_estimator(
    "hysteresis",
    _Hysteresis,
    "stance from on_force for on_dwell_s on, swing from below off_force for off_dwell_s on",
)
register_contact_estimator(
    "logistic",
    lambda config, legs: _ProbabilityThreshold(
        config, lambda load: logistic_probability(load, config.centre, config.width)
    ),
    "1 / (1 + exp(-(F - centre) / width)), stance from stance_probability on",
)
register_contact_estimator(
    "paper",
    lambda config, legs: _ProbabilityThreshold(config, lambda load: paper_probability(load, config.span)),
    "|F| / (|Fmax| - |Fmin|) clipped to 0..1 (section III-D), stance from stance_probability on",
)
register_contact_estimator(
    "kinematic",
    lambda config, legs: _Kinematic(config, legs, weighs_load=False),
    "by the motion of the feet and the IMU alone, whatever the load (contact.kinematic)",
)
register_contact_estimator(
    "kinematic_load",
    lambda config, legs: _Kinematic(config, legs, weighs_load=True),
    "by the motion of the feet, and the load as logistic weighs it, up to contact.kinematic.load_limit",
)
