# SPDX-License-Identifier: BSD-3-Clause
"""Memory of the filter over many cycles, as JSON.

``python -m coclo_vio.experiments.studies.filter_memory [CYCLES]`` (a million).
"""

import json
import os
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy: one core
os.environ.setdefault("OMP_NUM_THREADS", "1")

from coclo_vio.experiments.benchmark import filter_resident_mb

if __name__ == "__main__":
    cycles = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    held = filter_resident_mb(cycles)
    # from the first tenth on: what is allocated once is there by then
    print(json.dumps({"cycles": cycles, "resident_mb": held, "growth_mb": held[-1] - held[1]}, indent=2))
