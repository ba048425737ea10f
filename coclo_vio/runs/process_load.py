# SPDX-License-Identifier: BSD-3-Clause
"""Memory and processor time of processes, as Linux reports them; nothing elsewhere."""

import os
import time
from pathlib import Path

from coclo_vio.runs.latency import LoadRecord

_MEBIBYTE = 2.0**20
_USER_TIME, _SYSTEM_TIME = 11, 12  # fields of /proc/PID/stat after the name


class ProcessLoad:
    """The load of one process since the last time that it was asked for."""

    def __init__(self, pid: int) -> None:
        """Take the number of the process."""
        self._stat, self._statm = Path(f"/proc/{pid}/stat"), Path(f"/proc/{pid}/statm")
        self._before = self._cpu_s(), time.monotonic()

    def take(self) -> LoadRecord | None:
        """Memory now, and processor time since the last call; None where it is not known or the process is gone."""
        before_s, since_s = self._before
        now_s, at_s = self._before = self._cpu_s(), time.monotonic()
        try:
            pages = int(self._statm.read_text(encoding="ascii").split()[1])
        except (OSError, IndexError, ValueError):
            return None
        if not pages or now_s is None or before_s is None or at_s <= since_s:
            return None  # a process that has ended has no page until its end is waited for
        rss_mb = pages * os.sysconf("SC_PAGE_SIZE") / _MEBIBYTE
        return LoadRecord(rss_mb=rss_mb, cpu_percent=max(100.0 * (now_s - before_s) / (at_s - since_s), 0.0))

    def _cpu_s(self) -> float | None:
        try:
            fields = self._stat.read_text(encoding="utf-8").rpartition(")")[2].split()
        except OSError:
            return None
        return (int(fields[_USER_TIME]) + int(fields[_SYSTEM_TIME])) / os.sysconf("SC_CLK_TCK")
