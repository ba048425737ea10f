# SPDX-License-Identifier: BSD-3-Clause
"""The filter's speed beside filterpy's, as JSON: ``python -m coclo_vio.experiments.studies.filter_speed``."""

import json
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy: one core
os.environ.setdefault("OMP_NUM_THREADS", "1")

from coclo_vio.experiments.benchmark import run_benchmark

if __name__ == "__main__":
    print(json.dumps(run_benchmark(), indent=2))
