# SPDX-License-Identifier: BSD-3-Clause
"""From the load on a foot to contact: a probability and a decision for each leg.

The load comes from a foot sensor or from joint torques (``RobotModel.foot_forces``); the filter takes the answer.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator
from scipy.special import expit

from coclo_vio.values.arrays import Array, BoolArray
from coclo_vio.values.config import StageConfig
from coclo_vio.values.units import NS_PER_S


class ContactConfig(StageConfig):
    """How the load on a foot becomes contact. Forces are in N, or in the raw counts of a foot sensor."""

    source: Annotated[Literal["torque", "force_sensor"], Field(description="what the load is taken from")] = "torque"
    method: Annotated[
        Literal["paper", "logistic", "hysteresis"],
        Field(description="paper: |F| / (|Fmax| - |Fmin|); logistic; hysteresis: Schmitt trigger with dwell"),
    ] = "hysteresis"
    compensation: Annotated[
        Literal["none", "gravity", "inertia"],
        Field(description="what of the leg's own dynamics is taken out of the joint torques"),
    ] = "gravity"
    on_force: Annotated[float, Field(gt=0, description="load from which on a swing foot stands, N or counts")] = 20.0
    off_force: Annotated[float, Field(ge=0, description="load below which a stance foot lifts, N or counts")] = 12.0
    on_dwell_s: Annotated[float, Field(ge=0, le=1, description="time above on_force before stance, s")] = 0.0
    off_dwell_s: Annotated[float, Field(ge=0, le=1, description="time below off_force before swing, s")] = 0.0
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
        float, Field(gt=0, lt=1, description="probability from which on a foot stands (paper and logistic)")
    ] = 0.5

    @model_validator(mode="after")
    def _forces_are_in_order(self) -> Self:
        if self.off_force >= self.on_force:
            raise ValueError(f"off_force = {self.off_force} must lie below on_force = {self.on_force}")
        if (self.max_force is None) != (self.min_force is None):
            raise ValueError("max_force and min_force are recorded together; give both or neither")
        if self.max_force is not None and self.min_force is not None and self.min_force >= self.max_force:
            raise ValueError(f"min_force = {self.min_force} must lie below max_force = {self.max_force}")
        return self

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
        """The paper's ``|Fmax| - |Fmin|``; where nothing was recorded, on + off: 0.5 falls midway between them."""
        if self.max_force is None or self.min_force is None:
            return self.on_force + self.off_force
        return self.max_force - self.min_force


@dataclass(frozen=True, slots=True, eq=False)
class ContactState:
    """Contact of every leg at one time, in the order of the robot's legs.

    Attributes:
        probability: in 0..1, (legs,); 0 where the load is unknown.
        is_stance: the decision, (legs,).
        load: as given, N or counts, (legs,).
    """

    probability: Array
    is_stance: BoolArray
    load: Array


def paper_probability(load: Array, span: float) -> Array:
    """``|F| / (|Fmax| - |Fmin|)`` clipped to 0..1, (legs,) from a load (legs,) (paper, section III-D).

    The paper leaves open what happens above 1 (here clipped), that the ratio passes 1 already at Fmax - Fmin and is
    not 0 at Fmin, and over what time the two extremes are recorded: here they are configuration.
    """
    return np.clip(load / span, 0.0, 1.0)


def logistic_probability(load: Array, centre: float, width: float) -> Array:
    """``1 / (1 + exp(-(F - centre) / width))``, (legs,): grows with the load, 0.5 at the centre."""
    return np.asarray(expit((load - centre) / width), dtype=np.float64)


class ContactDetector:
    """Decides which feet stand, sample by sample, and how sure that is.

    ``hysteresis`` starts with every foot in swing. A load of NaN ends stance at once, with probability 0, and is
    counted; a stamp before the last one changes nothing and is counted.
    """

    def __init__(self, config: ContactConfig, legs: int) -> None:
        self.config = config
        self._on_dwell_ns = round(config.on_dwell_s * NS_PER_S)
        self._off_dwell_ns = round(config.off_dwell_s * NS_PER_S)
        self._is_stance: BoolArray = np.zeros(legs, dtype=np.bool_)
        self._since_ns = np.zeros(legs, dtype=np.int64)
        self._is_changing: BoolArray = np.zeros(legs, dtype=np.bool_)
        self._stamp_ns: int | None = None
        self._state = ContactState(np.zeros(legs), self._is_stance, np.full(legs, np.nan))
        self._counts = {"contact_load_missing": 0, "contact_stamp_backwards": 0}

    @property
    def counts(self) -> Mapping[str, int]:
        """Loads that were NaN, and samples refused for their stamp."""
        return self._counts

    def update(self, stamp_ns: int, load: Array) -> ContactState:
        """Take the loads (legs,), in N or counts, at ``stamp_ns``; returns the contact of every leg then."""
        if self._stamp_ns is not None and stamp_ns < self._stamp_ns:
            self._counts["contact_stamp_backwards"] += 1
            return self._state
        self._stamp_ns = stamp_ns
        missing = np.isnan(load)
        has_missing = bool(missing.any())
        known = load
        if has_missing:
            self._counts["contact_load_missing"] += int(missing.sum())
            known = np.where(missing, -np.inf, load)
        probability = self._probability(known)
        if self.config.method == "hysteresis":
            is_stance = self._schmitt(stamp_ns, known, missing)
        else:
            is_stance = probability >= self.config.stance_probability
        self._state = ContactState(probability, is_stance, load)
        return self._state

    def _probability(self, load: Array) -> Array:
        if self.config.method == "paper":
            return paper_probability(load, self.config.span)
        return logistic_probability(load, self.config.centre, self.config.width)

    def _schmitt(self, stamp_ns: int, load: Array, missing: BoolArray) -> BoolArray:
        """One step of the trigger; a change takes effect once its condition has held for the dwell time."""
        config = self.config
        wants_change = np.where(self._is_stance, load < config.off_force, load >= config.on_force)
        self._since_ns = np.where(wants_change & self._is_changing, self._since_ns, stamp_ns)
        dwell_ns = np.where(self._is_stance, self._off_dwell_ns, self._on_dwell_ns)
        changes = wants_change & ((stamp_ns - self._since_ns >= dwell_ns) | missing)
        self._is_stance = self._is_stance ^ changes
        self._is_changing = wants_change & ~changes
        return self._is_stance
