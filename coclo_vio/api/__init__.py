# SPDX-License-Identifier: BSD-3-Clause
"""What ``import coclo_vio`` offers: recordings, runs, comparisons, evaluation, online estimators. The command line uses
nothing else of the product."""
