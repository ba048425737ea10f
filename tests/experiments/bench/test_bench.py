# SPDX-License-Identifier: BSD-3-Clause
"""Records of costs, exponents, changes, and the comparison of two checkouts."""

import sys
from pathlib import Path

import pytest

from coclo_vio.experiments.bench.bench_figures import plot_scaling
from coclo_vio.experiments.bench.bench_record import BenchRecord, Endurance, StageCost, Sweep
from coclo_vio.experiments.bench.calibration_loop import calibration_s
from coclo_vio.experiments.bench.commit_speed import TimedCommand, processor_ratios, second_core
from coclo_vio.experiments.bench.sweeps import endured
from coclo_vio.experiments.results.provenance import Provenance
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.measurements import ImuSample

_ORIGIN = Provenance(commit="abc1234", date="2026-01-02", machine="one", versions={}, command="make bench")


def record(units: float) -> BenchRecord:
    stage = StageCost(what="a step", ms=10.0 * units, units=units)
    sweep = Sweep(what="a step", size="legs", sizes=(2.0, 4.0, 8.0), ms=(1.0, 2.0, 4.0), units=(0.1, 0.2, 0.4))
    long = Endurance(what="a step", minutes=(1.0, 2.0), ms=(1.0, 1.0), units=(0.1, 0.1), resident_mb=(100.0, 101.0))
    return BenchRecord(
        origin=_ORIGIN,
        calibration_ms=10.0,
        compile_s=3.0,
        stages={"step": stage},
        combined_realtime_factor=2.0,
        sweeps={"legs": sweep},
        endurance={"legs": long},
    )


def swept(sizes: tuple[float, ...], units: tuple[float, ...]) -> Sweep:
    """Units as given, on a core whose speed halves on the way."""
    slow = [10.0 if index < len(units) // 2 else 20.0 for index in range(len(units))]
    ms = tuple(each * unit_ms for each, unit_ms in zip(units, slow, strict=True))
    return Sweep(what="a cost", size="n", sizes=sizes, ms=ms, units=units)


@pytest.mark.parametrize("power", [0.0, 1.0, 2.5])
def test_the_exponent_of_a_power_is_the_power(power: float) -> None:
    sizes = (2.0, 3.0, 7.0, 20.0)
    sweep = swept(sizes, tuple(0.3 * size**power for size in sizes))
    assert sweep.exponent == pytest.approx(power, abs=1e-12)
    assert sweep.last_exponent == pytest.approx(power, abs=1e-12)


def test_fixed_costs_count_less_at_the_end() -> None:
    sizes = (1.0, 10.0, 100.0)
    sweep = swept(sizes, tuple(5.0 + size for size in sizes))
    assert sweep.exponent < sweep.last_exponent < 1.0


def test_a_record_is_read_back_and_drawn(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    record(2.0).write(tmp_path / "bench.json")
    read = BenchRecord.read(tmp_path / "bench.json")
    assert read == record(2.0)
    plot_scaling(read.sweeps, read.endurance, tmp_path / "scaling.png")
    assert (tmp_path / "scaling.png").stat().st_size > 5000


def test_changes_are_in_units_of_the_calibration_loop() -> None:
    assert record(2.0).changes_from(record(6.0)) == {"step": pytest.approx(3.0)}


def test_the_calibration_loop_takes_processor_time() -> None:
    assert 1e-3 < calibration_s(trials=1) < 10.0


def test_a_long_input_is_cut_into_stretches() -> None:
    samples = (ImuSample(stamp_ns, [0.0, 0.0, 0.0], [0.0, 0.0, 9.81]) for stamp_ns in range(0, 10**12, 10**9))
    pushed: list[int] = []
    long = endured("a sample", samples, lambda sample: pushed.append(sample.stamp_ns), ImuSample, minutes=5.0)
    assert long.minutes == (1.0, 2.0, 5.0)
    assert len(long.ms) == len(long.resident_mb) == 3
    assert pushed[-1] == 300 * 10**9
    assert min(long.ms) > 0.0


def checkout(folder: Path, steps: int) -> Path:
    """A package whose command line only counts, and writes one trajectory."""
    package = folder / "coclo_vio" / "cli"
    package.mkdir(parents=True)
    (package.parent / "__init__.py").write_text("", encoding="utf-8")
    (package / "__init__.py").write_text(
        "import sys\nfrom pathlib import Path\n"
        "def main():\n"
        "    if 'fail' in sys.argv: sys.exit('no such recording')\n"
        f"    sum(number * number for number in range({steps}))\n"
        "    out = Path(sys.argv[sys.argv.index('-o') + 1])\n"
        "    out.mkdir(parents=True)\n"
        "    (out / 'coclo.tum').write_text('0 0 0 0 0 0 0 1')\n",
        encoding="utf-8",
    )
    return folder


@pytest.mark.skipif(sys.platform != "linux", reason="processes are bound to a core, which Linux can")
def test_two_checkouts_are_compared_by_processor_time(tmp_path: Path) -> None:
    slow, fast = checkout(tmp_path / "slow", 8_000_000), checkout(tmp_path / "fast", 10)
    commands = {"count": TimedCommand("counting", ("run",))}
    ratio = processor_ratios(slow, fast, commands, rounds=1)["count"]
    assert ratio.ratio > 2.0
    assert ratio.before > ratio.after > 0.0
    with pytest.raises(DatasetError, match="ended with status 1: no such recording"):
        processor_ratios(slow, fast, {"fail": TimedCommand("failing", ("fail",))}, rounds=1)


@pytest.mark.skipif(sys.platform != "linux", reason="processes are bound to cores, which Linux can")
def test_a_second_core_has_to_give_the_same_bytes(tmp_path: Path) -> None:
    second = second_core(checkout(tmp_path / "one", 10), TimedCommand("counting", ("run",)), ("--threads",), rounds=1)
    assert second.is_same
    assert second.one_s > 0.0
