# SPDX-License-Identifier: BSD-3-Clause
"""SIGINT and SIGTERM finish the files, say what was done and how to go on, and give status 130 or 143."""

import os
import signal
from pathlib import Path

import pytest
from console import Coclo, is_one_sentence

from coclo_vio.runs import run_folder
from coclo_vio.runs.mode_run import ModeRun

NS = 1_000_000_000


def _signal_at(monkeypatch: pytest.MonkeyPatch, number: signal.Signals, stamp_ns: int, mode: str = "naive") -> None:
    """This process gets a signal as a mode has read a stamp."""
    advance = ModeRun._advance

    def advanced(self: ModeRun, now_ns: int) -> None:
        if self._ready.mode.name == mode and now_ns == stamp_ns:
            os.kill(os.getpid(), number)
        advance(self, now_ns)

    monkeypatch.setattr(ModeRun, "_advance", advanced)


@pytest.mark.long
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_signal_ends_a_run_in_order_and_resume_goes_on(
    number: signal.Signals, status: int, coclo: Coclo, leg_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = signal.getsignal(number)
    assert coclo("run", leg_log, "-m", "naive", "-o", "whole").status == 0
    with monkeypatch.context() as patched:
        _signal_at(patched, number, NS)
        answer = coclo("run", leg_log, "-m", "naive", "-o", "out")
    assert (answer.status, answer.out) == (status, "")
    lines = answer.err.splitlines()
    assert lines[-3] == f"stopped by {number.name}"
    assert lines[-2].startswith("out: naive interrupted, ")
    assert lines[-2].endswith("estimates up to 0.99 s of the recording") or lines[-2].endswith(
        "1.00 s of the recording"
    )
    assert lines[-1] == (
        "the same command with --resume goes on from here; coclo-vio evaluate out measures what is there"
    )
    assert signal.getsignal(number) is before
    assert run_folder.read_record(tmp_path / "out").status == "interrupted"
    evaluated = coclo("evaluate", "out")
    assert evaluated.status == 0
    assert "the run of naive was interrupted" in evaluated.err
    assert coclo("run", leg_log, "-m", "naive", "-o", "out", "--resume").status == 0
    for name in ("naive.tum", "naive_state.csv", "config.yaml"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


@pytest.mark.long
def test_a_signal_ends_a_comparison_and_resume_finishes_it(
    coclo: Coclo, leg_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arguments = ("compare", leg_log, "--modes", "naive,naive_weighted", "-o", "out")
    with monkeypatch.context() as patched:
        _signal_at(patched, signal.SIGTERM, 2 * NS, "naive_weighted")
        answer = coclo(*arguments)
    assert answer.status == 143
    assert "out: naive finished, 261 estimates up to 3.00 s of the recording" in answer.err
    assert "out: naive_weighted interrupted, " in answer.err
    assert not (tmp_path / "out" / "report.html").exists()
    assert coclo("evaluate", "out").status == 0
    assert coclo(*arguments, "--resume").status == 0
    assert (tmp_path / "out" / "report.html").is_file()
    assert run_folder.read_record(tmp_path / "out").status == "finished"


def test_results_are_replaced_only_on_request(coclo: Coclo, leg_log: Path, tmp_path: Path) -> None:
    arguments = ("run", leg_log, "-m", "naive")
    assert coclo(*arguments).status == 0
    before = (tmp_path / "out" / "run.json").read_bytes()
    for command in (arguments, ("compare", leg_log, "--modes", "naive")):
        refused = coclo(*command)
        assert (refused.status, refused.out) == (1, "")
        assert is_one_sentence(refused)
        assert (
            "out holds the results of an earlier run (run.json), which would be overwritten; give --overwrite to "
            in (refused.err)
        )
    assert (tmp_path / "out" / "run.json").read_bytes() == before
    assert coclo(*arguments, "--overwrite").status == 0
    both = coclo(*arguments, "--overwrite", "--resume")
    assert both.status == 2
    assert "--overwrite begins anew and --resume goes on: give one of the two" in both.err


def test_a_report_is_made_of_what_an_interrupted_run_left(
    coclo: Coclo, leg_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patched:
        _signal_at(patched, signal.SIGTERM, 2 * NS)
        assert coclo("run", leg_log, "-m", "naive", "-o", "out").status == 143
    answer = coclo("evaluate", "out", "--report")
    assert answer.status == 0
    assert "report: out/report.html" in answer.out
    assert "the run of naive was interrupted" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
