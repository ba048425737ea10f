# SPDX-License-Identifier: BSD-3-Clause
"""The modes: one file each family; ``registry`` finds them all, and those of plugins."""
