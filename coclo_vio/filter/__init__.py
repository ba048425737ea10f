# SPDX-License-Identifier: BSD-3-Clause
"""COCLO: contact-centric leg odometry by a square-root unscented Kalman filter (paper section III)."""
