# SPDX-License-Identifier: BSD-3-Clause
"""The only importer of GTSAM. Import its modules only when an estimator of it is made: GTSAM loads slowly."""
