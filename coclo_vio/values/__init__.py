# SPDX-License-Identifier: BSD-3-Clause
"""What flows between the stages: measurements, estimates, outputs, trajectories, calibration, errors."""
