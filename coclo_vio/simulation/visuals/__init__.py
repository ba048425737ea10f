# SPDX-License-Identifier: BSD-3-Clause
"""The simulated stereo camera: the textured scene, its rendering, and the model of the imagers."""
