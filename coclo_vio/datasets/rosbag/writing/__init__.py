# SPDX-License-Identifier: BSD-3-Clause
"""Writers of rosbags: recordings, and estimated trajectories."""
