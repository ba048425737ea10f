# SPDX-License-Identifier: BSD-3-Clause
"""Kernels from the cache are those of the present sources, all of them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from coclo_vio.geometry.compiled import IS_COMPILED

needs_numba = pytest.mark.skipif(not IS_COMPILED, reason="needs numba: pip install numba")

_CONSTANTS = "FIRST = {first}\n"
_CALLED = """
from coclo_vio.geometry.compiled import inlined

@inlined
def doubled(x):
    return {factor} * x
"""
_KERNEL = """
from coclo_vio.geometry.compiled import compiled
from called import doubled
from constants import FIRST

@compiled
def answer(x):
    return doubled(x) + _own(x)

@compiled
def _own(x):
    return FIRST * x

print(answer(10), answer.stats.cache_hits)
"""


def _answer(folder: Path, *, first: int, factor: int) -> list[str]:
    (folder / "constants.py").write_text(_CONSTANTS.format(first=first))
    (folder / "called.py").write_text(_CALLED.format(factor=factor))
    paths = os.pathsep.join([str(folder), *filter(None, sys.path)])
    environment = {**os.environ, "PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", "import kernel"]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=True, cwd=folder)
    return done.stdout.split()


@pytest.mark.long
@needs_numba
def test_a_kernel_is_compiled_anew_when_a_constant_or_a_kernel_of_another_file_changes(tmp_path: Path) -> None:
    (tmp_path / "kernel.py").write_text(_KERNEL)
    assert _answer(tmp_path, first=1, factor=2) == ["30", "Counter()"]
    assert _answer(tmp_path, first=1, factor=2)[0] == "30"
    assert "1" in _answer(tmp_path, first=1, factor=2)[-1]  # from the cache
    assert _answer(tmp_path, first=5, factor=2) == ["70", "Counter()"]
    assert _answer(tmp_path, first=5, factor=3) == ["80", "Counter()"]
