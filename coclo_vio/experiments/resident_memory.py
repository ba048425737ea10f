# SPDX-License-Identifier: BSD-3-Clause
"""Memory of this process, as reported by the system."""

import resource
import sys
from pathlib import Path

from coclo_vio.values.errors import CocloError

_MEBIBYTE = 2.0**20


def peak_rss_mb() -> float:
    """The largest memory of this process so far, MiB."""
    unit = 1.0 if sys.platform == "darwin" else 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / _MEBIBYTE


def resident_mb() -> float:
    """The present memory of this process, MiB.

    Raises:
        CocloError: the system does not report it (Linux does, in /proc).
    """
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError as error:
        raise CocloError("memory is measured on Linux only: there is no /proc/self/statm here") from error
    return pages * resource.getpagesize() / _MEBIBYTE
