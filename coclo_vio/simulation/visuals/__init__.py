# SPDX-License-Identifier: BSD-3-Clause
"""The simulator's eyes: what a trial looks like (scene), how it is drawn (renderer) and what the imager makes of it."""
