# SPDX-License-Identifier: BSD-3-Clause
"""The paper's Table I over seeds: trials simulated, run, measured and summed up; goes on where it was stopped."""
