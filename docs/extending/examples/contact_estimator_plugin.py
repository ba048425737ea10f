# SPDX-License-Identifier: BSD-3-Clause
"""A contact estimator: two thresholds, and a least duration of stance and of swing, so that no foot chatters."""

import numpy as np

import coclo_vio as cv
from coclo_vio.robot.contact import ContactConfig
from coclo_vio.values.arrays import Array


class LeastPhase:
    """Changes at once beyond a threshold, and not again before ``least_s`` have passed."""

    def __init__(self, config: ContactConfig, legs: int) -> None:
        self._config = config
        self._least_ns = round(config.parameters.get("least_s", 0.05) * 1e9)
        self._is_stance = np.zeros(legs, dtype=np.bool_)
        self._may_change_ns = np.zeros(legs, dtype=np.int64)

    def update(self, stamp_ns: int, load: Array) -> cv.ContactState:
        """The contact of every leg; one whose load is unknown swings."""
        known = np.nan_to_num(load, nan=-np.inf)
        threshold = np.where(self._is_stance, self._config.off_force, self._config.on_force)
        changes = ((known >= threshold) != self._is_stance) & (stamp_ns >= self._may_change_ns)
        changes |= self._is_stance & np.isnan(load)
        self._is_stance = self._is_stance ^ changes
        self._may_change_ns = np.where(changes, stamp_ns + self._least_ns, self._may_change_ns)
        probability = np.clip(known / (self._config.on_force + self._config.off_force), 0.0, 1.0)
        return cv.ContactState(probability, self._is_stance, load)


RULE = "stance from on_force on, swing from below off_force on, each for least_s at least"
cv.register_contact_estimator("least_phase", LeastPhase, RULE, parameters=("least_s",))
