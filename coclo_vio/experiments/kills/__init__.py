# SPDX-License-Identifier: BSD-3-Clause
"""Commands that are ended at random moments: what they leave, and what they come to when they are resumed."""
