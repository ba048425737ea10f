# SPDX-License-Identifier: BSD-3-Clause
"""The robot: its legs from a URDF through Pinocchio, which feet are in contact, and whether it stands still."""
