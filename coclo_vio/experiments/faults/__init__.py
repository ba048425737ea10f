# SPDX-License-Identifier: BSD-3-Clause
"""Faults as a matrix: each fault alone, through every mode, on recordings of two robots."""
