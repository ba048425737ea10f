# SPDX-License-Identifier: BSD-3-Clause
"""``python -m coclo_vio.experiments.kills -o OUT --kills 100``: ends commands at random moments, and resumes them.

KILL, TERM and INT in turn, over ``run`` and ``compare`` of legs on the bundled sample, ``run`` of modes with cameras
on its first seconds, and a small ``table`` in two processes. Each is compared with the same command that was not ended,
which runs once. Results are in OUT/kills.json; with ``--publish`` also in docs/results and on the page.
"""

import argparse
import random
import shutil
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from coclo_vio.experiments.bench.compilation import run_all_kernels
from coclo_vio.experiments.kills.ended_process import EXPECTED, EndedProcess, finished
from coclo_vio.experiments.kills.ended_table import compared_tables, jobs_of, left_of_table
from coclo_vio.experiments.kills.kill_cases import Case, all_cases
from coclo_vio.experiments.kills.kill_record import Kill, KillsRecord
from coclo_vio.experiments.kills.kill_text import HEAD, amiss_lines, rows, summary_sentence
from coclo_vio.experiments.kills.what_is_left import Comparison, compared, left_of
from coclo_vio.experiments.results.measuring import RESULTS
from coclo_vio.experiments.results.pages import render
from coclo_vio.experiments.results.provenance import Provenance, Provenances
from coclo_vio.runs import run_folder
from coclo_vio.values.errors import CocloError, DatasetError

_SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
_FILE = "kills.json"
_MOST_TRIALS = 10
_LEG_MODES, _VISUAL_MODES, _TABLE_MODES = "coclo,naive,inekf", "combined,vins,tight", "naive,naive_weighted,coclo"


@dataclass(slots=True)
class Killer:
    """Ends commands, each compared with its whole run.

    Attributes:
        output: folder of all runs.
        took_s: how long the whole commands took, by case; for those whose position is not shown.
    """

    output: Path
    took_s: dict[str, float] = field(default_factory=dict)

    def whole(self, case: Case) -> Path:
        """The folder of a command that was not ended; it runs once in a session.

        Raises:
            DatasetError: it failed.
        """
        folder = self.output / f"whole_{case.name}"
        if case.name not in self.took_s:
            shutil.rmtree(folder, ignore_errors=True)
            began_s = time.monotonic()
            stamp_file = self.output / f"whole_{case.name}.stamp"
            status = finished(case.arguments(folder), stamp_file)
            if status != 0:
                raise DatasetError(
                    f"{case.command} {case.modes} ended with status {status} though nothing ended it: see "
                    f"{stamp_file.with_suffix('.log')}"
                )
            self.took_s[case.name] = time.monotonic() - began_s
        return folder

    def kill(self, case: Case, sent: signal.Signals, share: float) -> Kill:
        """End a command when it has done ``share`` of its work, look at what is left, and resume it.

        Where it has come to its end before the signal, it is begun anew and ended earlier.

        Raises:
            DatasetError: the whole command failed, or it comes to its end again and again.
        """
        whole, folder = self.whole(case), self.output / "killed"
        status, share, read_ns = self._ended(case, sent, share, whole, folder)
        if case.command == "table":
            left, before = left_of_table(folder), jobs_of(folder)
        else:
            left, before = left_of(folder, whole, _mode_at(whole, share), read_ns), {}
        resumed_status = finished(case.resuming(folder), self.output / "resumed.stamp")
        try:
            after = compared_tables(whole, folder, before) if case.command == "table" else compared(whole, folder)
        except CocloError:
            after = Comparison(None, False, {})
        return Kill(
            command=case.command,
            modes=case.modes,
            signal=sent.name,
            at_share=round(share, 4),
            status=status,
            is_status_right=status == EXPECTED[sent],
            lost_s=left.lost_s,
            left=left.left,
            reason=left.reason,
            resumed_status=resumed_status,
            resumed_from_s=after.resumed_from_s,
            difference=after.difference,
            has_same_events=after.has_same_events,
        )

    def _ended(
        self, case: Case, sent: signal.Signals, share: float, whole: Path, folder: Path
    ) -> tuple[int, float, int]:
        """A command that is ended: its status, the share of its work, and the newest stamp it had read."""
        for _ in range(_MOST_TRIALS):
            shutil.rmtree(folder, ignore_errors=True)
            process = EndedProcess(case.arguments(folder), self.output / "killed.stamp")
            status, read_ns = None, 0
            if case.command == "table":
                count = len(jobs_of(whole))
                number, part = divmod(share * count, 1.0)
                job_s = part * self.took_s[case.name] / count
                status = process.end_after(int(number), job_s, folder / "jobs", sent)
            else:
                record = run_folder.read_record(whole)
                start_ns, end_ns = record.recording_ns or (0, 0)
                number, part = divmod(share * len(record.by_mode()), 1.0)
                status, read_ns = process.end_at(int(number), start_ns + round(part * (end_ns - start_ns)), sent)
            if status is not None:
                return status, share, read_ns
            share *= 0.8
        raise DatasetError(f"{case.command} {case.modes} comes to its end before it can be ended")


def _mode_at(whole: Path, share: float) -> str:
    """The mode that runs when a share of the work is done."""
    modes = list(run_folder.read_record(whole).by_mode())
    return modes[min(int(share * len(modes)), len(modes) - 1)]


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; returns its status: 0 where every kill is as it should be."""
    given = _parser().parse_args(arguments)
    try:
        record = _killed(given)
    except CocloError as error:
        print(f"kills: {error}", file=sys.stderr)
        return 1
    for row in (HEAD, *rows(record)):
        print(" | ".join(row))
    for line in (summary_sentence(record), *amiss_lines(record)):
        print(line)
    if given.publish:
        root = Path.cwd()
        origin = Provenance.now(f"python -m coclo_vio.experiments.kills -o OUT --kills {given.kills}", root)
        record.write(root / RESULTS / _FILE)
        known = root / RESULTS / "provenance.json"
        Provenances.read(known).with_entry(_FILE, origin).write(known)
        for page in render(root):
            print(f"wrote {page}")
    return 0 if record.summary.passed == record.summary.kills else 1


def _killed(given: argparse.Namespace) -> KillsRecord:
    """All kills; the record is written after each."""
    output = given.output.resolve()
    cases = all_cases(output / "recordings", given.interval, given.modes, given.visual_modes, given.table_modes)
    run_all_kernels()  # compiles them once, not in a process that is ended
    killer, rng = Killer(output), random.Random(given.seed)
    kills: list[Kill] = []
    for number in range(given.kills):
        case, sent = cases[number % len(cases)], _SIGNALS[(number + number // len(cases)) % len(_SIGNALS)]
        kills.append(killer.kill(case, sent, rng.random()))
        print(kills[-1], flush=True)
        KillsRecord.of(kills).write(output / _FILE)
    return KillsRecord.of(kills)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="kills", description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder for recordings, runs and kills.json")
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--interval", type=float, default=3.0, help="seconds between checkpoints")
    parser.add_argument("--modes", default=_LEG_MODES, help="of run, one after the other; compare takes them all")
    parser.add_argument("--visual-modes", default=_VISUAL_MODES, help="of run with images; empty for none")
    parser.add_argument("--table-modes", default=_TABLE_MODES, help="of table; empty for no table")
    parser.add_argument("--publish", action="store_true", help="write docs/results/kills.json and the pages")
    return parser


if __name__ == "__main__":
    sys.exit(main())
