# SPDX-License-Identifier: BSD-3-Clause
"""The estimator on a wire: sources of messages, the loop that feeds them, and what goes out again."""
