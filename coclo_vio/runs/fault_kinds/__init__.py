# SPDX-License-Identifier: BSD-3-Clause
"""Simulated faults, a module for each kind of sensor; ``runs/faults.py`` puts them on a recording."""
