# SPDX-License-Identifier: BSD-3-Clause
"""Minutes of messages between two processes on one computer: every one accounted for, and its time under way."""
