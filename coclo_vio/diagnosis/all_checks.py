# SPDX-License-Identifier: BSD-3-Clause
"""The checks there are: a further one is one function in ``checks`` and one row here."""

from coclo_vio.diagnosis.diagnose import Check

CHECKS: tuple[Check, ...] = ()
