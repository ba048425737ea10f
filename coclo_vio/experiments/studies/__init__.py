# SPDX-License-Identifier: BSD-3-Clause
"""Studies that measure one thing each over many trials: ``python -m coclo_vio.experiments.studies.NAME``.

Importing the package limits linear algebra to one thread: a study runs one process a core.
"""

import os

for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # read when NumPy is imported, which is later
    os.environ.setdefault(_variable, "1")
