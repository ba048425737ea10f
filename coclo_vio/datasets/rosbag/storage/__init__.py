# SPDX-License-Identifier: BSD-3-Clause
"""Bags as files: topics and messages as bytes, of sound files and of the readable part of damaged ones."""
