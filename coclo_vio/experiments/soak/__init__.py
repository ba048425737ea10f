# SPDX-License-Identifier: BSD-3-Clause
"""A recording played round after round for an hour: latency, memory and drift over time."""
