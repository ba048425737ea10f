# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of an estimator while it runs and afterwards: what goes in and comes out, drawn in Foxglove or Rerun."""
