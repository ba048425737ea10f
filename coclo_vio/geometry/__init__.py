# SPDX-License-Identifier: BSD-3-Clause
"""Rotations and rigid transforms. ``T_a_b`` maps b coordinates to a; errors are right/local, rotation first."""
