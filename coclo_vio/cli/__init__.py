# SPDX-License-Identifier: BSD-3-Clause
"""The command line ``coclo-vio``: the only place that prints or exits."""

from coclo_vio.cli.application import app, main

__all__ = ["app", "main"]
