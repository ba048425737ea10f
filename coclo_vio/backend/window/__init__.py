# SPDX-License-Identifier: BSD-3-Clause
"""The sliding-window smoother: tracks and relative motion in, poses of the body out."""
