# SPDX-License-Identifier: BSD-3-Clause
"""GTSAM's factors, values and preintegrated readings as text, by GTSAM's own serialisation, and back."""

from importlib import import_module
from typing import Any

import gtsam

from coclo_vio.values.errors import DatasetError

_KEPT = (
    *(gtsam.Values, gtsam.Pose3, gtsam.imuBias.ConstantBias, gtsam.LinearContainerFactor, gtsam.BetweenFactorPose3),
    *(gtsam.PriorFactorPose3, gtsam.PriorFactorVector, gtsam.PriorFactorConstantBias),
    *(gtsam.CombinedImuFactor, gtsam.PreintegratedCombinedMeasurements, gtsam.PreintegrationCombinedParams),
)  # whose serialisation is exact; that of a stereo calibration, for one, ends the process
_CHANGING = (gtsam.Values, gtsam.PreintegratedCombinedMeasurements, gtsam.NonlinearFactorGraph)


class SerialisedGtsam:
    """Writes and reads what GTSAM can serialise."""

    def changes(self, thing: Any) -> bool:
        """Whether an object is of a class that changes; factors, poses, parameters and calibrations do not."""
        return isinstance(thing, _CHANGING)

    def write(self, thing: Any) -> str | None:
        """An object as text; None where GTSAM has no exact text for its class."""
        return str(thing.serialize()) if type(thing) in _KEPT else None

    def read(self, kind: str, text: str) -> Any:
        """The object of a class of GTSAM.

        Raises:
            DatasetError: GTSAM has no such class, or cannot read the text.
        """
        module, _, name = kind.partition(":")
        if module.partition(".")[0] != gtsam.__name__:
            raise DatasetError(f"a checkpoint names {kind}, which is no part of GTSAM; begin anew with --overwrite")
        try:
            kind_found = getattr(import_module(module), name)
            made = kind_found.__new__(kind_found)
            made.__setstate__((text,))
        except (ImportError, AttributeError, RuntimeError, TypeError) as error:
            raise DatasetError(
                f"a checkpoint holds a {kind} that this GTSAM cannot read; begin anew with --overwrite"
            ) from error
        return made
