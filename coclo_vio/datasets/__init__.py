# SPDX-License-Identifier: BSD-3-Clause
"""Recordings: readers, one file a format, and the writer. A reader yields one time-ordered stream of measurements."""
