# SPDX-License-Identifier: BSD-3-Clause
"""Bags as files: topics and messages as bytes, of whole files and of what is left of damaged ones."""
