# SPDX-License-Identifier: BSD-3-Clause
"""The grid of conditions: every mode on simulated trials whose legs, vision and IMUs are of many qualities."""
