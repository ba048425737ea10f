# SPDX-License-Identifier: BSD-3-Clause
"""Studies that measure one thing each over many trials: ``python -m coclo_vio.experiments.studies.NAME``."""
