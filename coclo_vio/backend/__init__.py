# SPDX-License-Identifier: BSD-3-Clause
"""The only importer of GTSAM. Import a module of it when its estimator is asked for: GTSAM takes its time to load."""
