# SPDX-License-Identifier: BSD-3-Clause
"""Estimators made of stages: visual odometry, and legs and vision combined."""
