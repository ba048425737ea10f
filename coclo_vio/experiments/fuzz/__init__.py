# SPDX-License-Identifier: BSD-3-Clause
"""Damaged and odd inputs for the readers: what is not refused in one sentence within limits is a finding."""
