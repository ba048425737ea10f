# SPDX-License-Identifier: BSD-3-Clause
"""Stereo images to tracks of points."""
