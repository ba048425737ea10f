# SPDX-License-Identifier: BSD-3-Clause
"""``python -m coclo_vio.experiments.fuzz --inputs N --seed S --seconds T -o OUT``: changed inputs for all readers.

Input ``number`` of a seed is the same in every run; ``--first`` goes on where another run ended. Prints JSON: inputs
by kind and result, and each distinct finding with its first input, which is kept in OUT. Exit status 1 with findings.
"""

import argparse
import json
import sys
import tempfile
import time
import warnings
from collections import Counter
from functools import partial
from pathlib import Path

from coclo_vio.experiments.fuzz.bounded_worker import Outcome, outcomes
from coclo_vio.experiments.fuzz.fuzz_seeds import seed_inputs
from coclo_vio.experiments.fuzz.reading_cases import Case, Seeds, make_case


def main(arguments: list[str] | None = None) -> int:
    """Run the cases and print what was found."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--inputs", type=int, default=1000, help="how many")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=float("inf"), help="stop after this time")
    parser.add_argument("-o", "--out", type=Path, default=Path("fuzz_findings"), help="where inputs of findings go")
    options = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    record = fuzz(range(options.first, options.first + options.inputs), options.seed, options.seconds, options.out)
    print(json.dumps(record, indent=1))
    return 1 if record["findings"] else 0


def fuzz(numbers: range, seed: int, seconds: float, kept: Path) -> dict[str, object]:
    """Run the cases of ``numbers`` until the time is over; inputs of findings are kept in ``kept``."""
    begin_s = time.monotonic()
    counts: dict[str, Counter[str]] = {}
    findings: dict[tuple[str, str], list[Outcome]] = {}
    with tempfile.TemporaryDirectory(prefix="fuzz") as scratch:
        seeds = seed_inputs(Path(scratch))
        make = partial(_case, seed, seeds)
        for outcome in outcomes(numbers, make, Path(scratch) / "cases", kept / str(seed)):
            counts.setdefault(outcome.kind, Counter())[outcome.result] += 1
            if outcome.is_finding:
                print(json.dumps(outcome._asdict()), file=sys.stderr, flush=True)
                findings.setdefault((outcome.result, outcome.detail.rpartition(" at ")[2]), []).append(outcome)
            if time.monotonic() - begin_s > seconds:
                break
    return {
        "seed": seed,
        "inputs": sum(sum(count.values()) for count in counts.values()),
        "seconds": round(time.monotonic() - begin_s, 1),
        "by_kind": {kind: dict(count) for kind, count in sorted(counts.items())},
        "findings": [
            {"times": len(found), "input": str(kept / str(seed) / str(found[0].number)), **found[0]._asdict()}
            for found in findings.values()
        ],
    }


def _case(seed: int, seeds: Seeds, number: int, folder: Path) -> Case:
    return make_case(number, seed, seeds, folder)


if __name__ == "__main__":
    sys.exit(main())
