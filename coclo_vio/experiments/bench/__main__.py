# SPDX-License-Identifier: BSD-3-Clause
"""``python -m coclo_vio.experiments.bench``: measure costs, compare with an earlier record, write JSON and plots."""

import argparse
import sys
from pathlib import Path

from coclo_vio.experiments.bench.bench_figures import plot_scaling
from coclo_vio.experiments.bench.bench_record import BenchRecord
from coclo_vio.experiments.bench.commit_speed import measure_commits
from coclo_vio.experiments.bench.measuring_bench import measure_bench
from coclo_vio.experiments.bench.sweeps import SWEEPS
from coclo_vio.values.errors import CocloError

_SHARED = Path("..") / "shared" / "data"


def main() -> None:
    """Measure what the arguments ask for."""
    arguments = _arguments()
    root = Path.cwd()
    try:
        if arguments.before:
            speed = measure_commits(arguments.before, root, _SHARED if _SHARED.is_dir() else None, arguments.rounds)
            speed.write(arguments.out)
            for ratio in speed.ratios.values():
                print(f"{ratio.what:60} {ratio.before:8.2f} {ratio.after:8.2f} {ratio.ratio:6.2f} x")
            return
        before = BenchRecord.read(arguments.against) if arguments.against.is_file() else None
        sweeps = [*SWEEPS] if arguments.scaling else []
        record = measure_bench(
            "make bench" if not arguments.scaling else "make bench-scaling",
            root,
            sweeps=sweeps,
            endurance_min=arguments.minutes,
            rounds=arguments.rounds,
            say=lambda name: print(f"measuring {name}", file=sys.stderr),
        )
        record.write(arguments.out)
        if record.sweeps and arguments.plot:
            plot_scaling(record.sweeps, record.endurance, arguments.plot)
    except CocloError as error:
        sys.exit(f"bench: {error}")
    _print(record, before)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--out", type=Path, required=True, help="JSON file to write")
    parser.add_argument("--against", type=Path, default=Path("docs/results/bench.json"), help="record to compare with")
    parser.add_argument("--scaling", action="store_true", help="also measure how costs grow with the problem")
    parser.add_argument("--minutes", type=float, default=0.0, help="also process this much input at a stretch, min")
    parser.add_argument("--plot", type=Path, help="PNG of the scaling")
    parser.add_argument("--rounds", type=int, default=3, help="repetitions, the least counts")
    parser.add_argument("--before", help="a commit: measure how many times as fast the present one is instead")
    return parser.parse_args()


def _print(record: BenchRecord, before: BenchRecord | None) -> None:
    changes = {} if before is None else record.changes_from(before)
    print(f"calibration loop {record.calibration_ms:.1f} ms = 1 unit")
    for name, stage in record.stages.items():
        change = f"{changes[name]:6.2f} x as fast as the record" if name in changes else ""
        print(f"{stage.what:56} {stage.ms:9.3f} ms {stage.units:8.4f} units {change}")
    print(f"combined, four legs at 500 Hz, stereo at 15 Hz: {record.combined_realtime_factor:.2f} times real time")
    if record.compile_s is not None:
        print(f"compiling all kernels once: {record.compile_s:.1f} s")
    for sweep in record.sweeps.values():
        print(f"{sweep.what} by {sweep.size}: exponent {sweep.exponent:.2f}, at the end {sweep.last_exponent:.2f}")


if __name__ == "__main__":
    main()
