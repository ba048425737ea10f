# SPDX-License-Identifier: BSD-3-Clause
"""Cost of every stage relative to a fixed piece of work, and how it grows with the size of the problem."""
