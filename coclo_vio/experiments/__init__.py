# SPDX-License-Identifier: BSD-3-Clause
"""Experiments on the product, none of which it needs: Table I, benchmarks, rivals, studies, the sample's maker.

Importing the package limits linear algebra to one thread, as the command line does: on small matrices several threads
double the processor time and save none.
"""

import os

for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # read when NumPy is imported, which is later
    os.environ.setdefault(_variable, "1")
