# SPDX-License-Identifier: BSD-3-Clause
"""What physics, the recording itself or the robot's description contradict in a recording, and how to correct it."""
