# SPDX-License-Identifier: BSD-3-Clause
"""Recordings through estimators: modes, equipment, pipeline, run folders, records."""
