# SPDX-License-Identifier: BSD-3-Clause
"""The fuzzer: cases are the same for the same seed, findings are found, and the readers have none in a few cases."""

import os
import time
from pathlib import Path

import numpy as np
import pytest

from coclo_vio.experiments.fuzz import bounded_worker
from coclo_vio.experiments.fuzz.__main__ import fuzz
from coclo_vio.experiments.fuzz.bounded_worker import outcomes
from coclo_vio.experiments.fuzz.fuzz_seeds import seed_inputs
from coclo_vio.experiments.fuzz.reading_cases import WEIGHTS, Case, make_case
from coclo_vio.values.errors import DatasetError


def _fail(error: Exception) -> None:
    raise error


def _wrapped() -> None:
    try:
        raise MemoryError
    except MemoryError as error:
        raise DatasetError("damaged") from error


READINGS = {
    0: lambda: None,
    1: lambda: _fail(DatasetError("refused")),
    2: lambda: _fail(KeyError("x")),
    3: lambda: time.sleep(30),
    4: lambda: np.ones(2**28),
    5: lambda: os._exit(3),
    6: lambda: _fail(DatasetError("two\nlines")),
    7: _wrapped,
    8: lambda: None,
}


def _made(number: int, folder: Path) -> Case:
    (folder / "input").write_text(str(number), encoding="utf-8")
    return Case("made", folder / "input", {"reading": READINGS[number]})


def test_every_kind_of_finding_is_found_and_its_input_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bounded_worker, "TIME_LIMIT_S", 1)
    found = list(outcomes(range(9), _made, tmp_path / "cases", tmp_path / "kept"))
    assert [outcome.number for outcome in found] == list(range(9))
    assert [outcome.result for outcome in found] == [
        "read",
        "refused",
        "KeyError",
        "takes too long",
        found[4].result,
        "dies",
        "message of several lines",
        "takes too much memory",
        "read",
    ]
    assert "Memory" in found[4].result
    assert sorted(int(path.name) for path in (tmp_path / "kept").iterdir()) == [2, 3, 4, 5, 6, 7]
    assert (tmp_path / "kept" / "3" / "input").read_text(encoding="utf-8") == "3"


def test_an_input_is_the_same_for_the_same_seed(tmp_path: Path) -> None:
    seeds = seed_inputs(tmp_path)
    texts = []
    for run in ("a", "b"):
        for number in range(6):
            folder = tmp_path / run / str(number)
            folder.mkdir(parents=True)
            case = make_case(number, 7, seeds, folder)
            texts.append(case.path.read_bytes() if case.path.is_file() else b"")
    assert texts[:6] == texts[6:]
    assert len(set(texts)) > 3


def test_bags_are_a_third_of_the_inputs() -> None:
    bags = sum(weight for kind, weight in WEIGHTS.items() if kind.endswith(("bag", "mcap", "db3", "metadata")))
    assert bags >= sum(WEIGHTS.values()) / 3


def test_the_readers_refuse_a_few_inputs_in_one_sentence_each(tmp_path: Path) -> None:
    record = fuzz(range(60), 1, float("inf"), tmp_path)
    assert record["findings"] == []
    assert record["inputs"] == 60
