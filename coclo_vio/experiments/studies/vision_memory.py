# SPDX-License-Identifier: BSD-3-Clause
"""Memory of the eyes over many frames, as JSON.

``python -m coclo_vio.experiments.studies.vision_memory [FRAMES]`` (ten thousand).
"""

import json
import os
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy: one core
os.environ.setdefault("OMP_NUM_THREADS", "1")

from coclo_vio.experiments.vision_benchmark import vision_resident_mb

if __name__ == "__main__":
    frames = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    held = vision_resident_mb(frames)
    # from the first tenth on: what is allocated once is there by then
    print(json.dumps({"frames": frames, "resident_mb": held, "growth_mb": held[-1] - held[1]}, indent=2))
