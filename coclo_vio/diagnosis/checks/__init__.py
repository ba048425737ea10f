# SPDX-License-Identifier: BSD-3-Clause
"""The checks of a diagnosis, one file a kind."""
