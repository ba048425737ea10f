# SPDX-License-Identifier: BSD-3-Clause
"""``python -m coclo_vio.experiments.wire zenoh dds -o OUT``: five minutes of each wire between two processes."""

import argparse
import json
import sys
from pathlib import Path

from coclo_vio.experiments.wire.loopback import WireTrial, run_trial
from coclo_vio.values.errors import CocloError


def main() -> int:
    """Run the trials; returns the exit status: 1 where a message is not accounted for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("wires", nargs="+", choices=("zenoh", "dds", "unitree"))
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--mode", default="coclo")
    parser.add_argument("-o", "--output", type=Path, default=Path("out/wire"))
    given = parser.parse_args()
    found = []
    for wire in given.wires:
        try:
            found.append(run_trial(WireTrial(wire, given.seconds, given.mode, given.output / wire)))
        except CocloError as error:
            print(error, file=sys.stderr)
            return 1
        print(json.dumps(found[-1], indent=2), flush=True)
    (given.output / "wire.json").write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    return int(any(topic["unaccounted"] for one in found for topic in one["topics"].values()))


if __name__ == "__main__":
    sys.exit(main())
