# SPDX-License-Identifier: BSD-3-Clause
"""How far an estimate is from ground truth: clock, alignment, metrics, consistency, figures, report."""
