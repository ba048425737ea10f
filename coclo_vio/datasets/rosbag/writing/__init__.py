# SPDX-License-Identifier: BSD-3-Clause
"""Bags being written: recordings, and what estimators found in them."""
