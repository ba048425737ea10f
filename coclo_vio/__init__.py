# SPDX-License-Identifier: BSD-3-Clause
"""State estimation for legged robots from what they feel and what they see."""

__version__ = "0.1.0"
