# SPDX-License-Identifier: BSD-3-Clause
"""What is not installed unless somebody asks for it."""

import importlib

from coclo_vio.values.errors import SimulationError


def check_simulator(wanting: str, extras: str) -> None:
    """See that MuJoCo is installed.

    Args:
        wanting: what needs it.
        extras: those that bring all it needs, separated by commas.

    Raises:
        SimulationError: it is not installed.
    """
    try:
        importlib.import_module("coclo_vio.simulation.simulated_recording")
    except ModuleNotFoundError as error:
        if error.name != "mujoco":
            raise
        raise SimulationError(
            f"{wanting} needs MuJoCo, which is an extra: pip install 'coclo-vio[{extras}]'"
        ) from error
