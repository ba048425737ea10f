# SPDX-License-Identifier: BSD-3-Clause
"""The benchmark of legged odometry: simulated trots, walks of a Daisy and real logs through every estimator of legs."""
