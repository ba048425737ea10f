# SPDX-License-Identifier: BSD-3-Clause
"""Results that pages show: measured into JSON with their origin, and written into pages from there, never by hand."""
