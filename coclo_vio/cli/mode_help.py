# SPDX-License-Identifier: BSD-3-Clause
"""Help of options that depends on the modes there are, those of plugins included."""

from typing import Any

from typer.core import TyperCommand

MODES_PLACE = "{modes}"
DEFAULTS_PLACE = "{defaults}"


class ModeCommand(TyperCommand):
    """A command in whose help the names of the modes stand in place of ``MODES_PLACE``."""

    def get_params(self, ctx: Any) -> Any:
        """The parameters, with their help filled in."""
        parameters = super().get_params(ctx)
        for parameter in parameters:
            fill_in(parameter)
        return parameters


def fill_in(parameter: Any) -> None:
    """Put the names of the modes into the help of an option, where it has a place for them."""
    text = getattr(parameter, "help", None)
    if not text or not (MODES_PLACE in text or DEFAULTS_PLACE in text):
        return
    from coclo_vio.runs.modes.registry import modes  # noqa: PLC0415 -- loads numpy

    ranked = sorted((mode.default_rank, name) for name, mode in modes().items() if mode.default_rank is not None)
    defaults = ", otherwise ".join(name for _, name in ranked)
    parameter.help = text.replace(MODES_PLACE, ", ".join(modes())).replace(DEFAULTS_PLACE, defaults)
