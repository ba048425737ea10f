# SPDX-License-Identifier: BSD-3-Clause
"""Memory of the filter or of vision over a long run, as JSON.

``python -m coclo_vio.experiments.studies.memory_study filter [CYCLES]`` (a million), or ``vision [FRAMES]`` (ten
thousand).
"""

import argparse
import json
from collections.abc import Callable, Mapping, Sequence

from coclo_vio.experiments.benchmark import filter_resident_mb
from coclo_vio.experiments.vision_benchmark import vision_resident_mb

# By the part of the estimator: the unit of a run's length, the default length, and the measurement.
PARTS: Mapping[str, tuple[str, int, Callable[[int], Sequence[float]]]] = {
    "filter": ("cycles", 1_000_000, filter_resident_mb),
    "vision": ("frames", 10_000, vision_resident_mb),
}


def main() -> None:
    """Measure, and print the result."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("part", choices=PARTS)
    parser.add_argument("count", type=int, nargs="?", help="cycles of the filter, or frames of vision")
    options = parser.parse_args()
    unit, default, measure = PARTS[options.part]
    count = options.count or default
    resident_mb = measure(count)
    # growth from the first tenth on: what is allocated once is resident by then
    result = {unit: count, "resident_mb": resident_mb, "growth_mb": resident_mb[-1] - resident_mb[1]}
    print(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
