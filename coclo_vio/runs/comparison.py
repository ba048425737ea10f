# SPDX-License-Identifier: BSD-3-Clause
"""Several estimators side by side: ``running`` a recording, ``evaluating`` what came out, ``writing`` the report."""

from coclo_vio.runs.comparison_report import Compared, write_comparison, write_comparisons, write_evaluations
from coclo_vio.runs.evaluating import evaluate_run, evaluate_tum
from coclo_vio.runs.running import Progress, run_all

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
