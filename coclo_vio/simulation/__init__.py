# SPDX-License-Identifier: BSD-3-Clause
"""Trials with known truth."""
