# SPDX-License-Identifier: BSD-3-Clause
"""Several estimators side by side: ``running`` a recording, ``evaluating`` what came out, ``writing`` the report."""

from coclo_vio.comparison.evaluating import evaluate_run, evaluate_tum
from coclo_vio.comparison.running import Progress, run_all
from coclo_vio.comparison.writing import Compared, write_comparison, write_comparisons, write_evaluations

__all__ = [
    "Compared",
    "Progress",
    "evaluate_run",
    "evaluate_tum",
    "run_all",
    "write_comparison",
    "write_comparisons",
    "write_evaluations",
]
