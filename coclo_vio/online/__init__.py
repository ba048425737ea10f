# SPDX-License-Identifier: BSD-3-Clause
"""In front of any estimator: order and clocks of what drivers push."""
