# SPDX-License-Identifier: BSD-3-Clause
"""Measures all costs into one record."""

from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from coclo_vio.experiments.bench.bench_record import BenchRecord, StageCost
from coclo_vio.experiments.bench.calibration_loop import calibration_s
from coclo_vio.experiments.bench.compilation import compile_s
from coclo_vio.experiments.bench.costs import (
    WalkKind,
    combined_realtime_factor,
    front_end_ms,
    keyframe_ms,
    leg_sample_ms,
    quadruped_with_stereo,
)
from coclo_vio.experiments.bench.sweeps import ENDURANCE, SWEEPS
from coclo_vio.experiments.benchmark import benchmark_trial, filter_cycles_per_s, moving_readings
from coclo_vio.experiments.results.provenance import Provenance
from coclo_vio.experiments.vision_benchmark import vision_figures
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.values.units import MS_PER_S

_VISION_S = 20.0


def _filter_cycle_ms() -> float:
    robot = RobotModel(load_robot("daisy"))
    readings = moving_readings(robot, benchmark_trial(robot, 8.0).measurements)
    return MS_PER_S / filter_cycles_per_s(robot, readings, "robust")


def _vision_frame_ms() -> float:
    return vision_figures(_VISION_S)["vision_ms_per_frame"] or 0.0


STAGES: Mapping[str, tuple[str, Callable[[], float]]] = {
    "filter_cycle": ("filter of six legs, predict and update, a cycle", _filter_cycle_ms),
    "legs_6": (
        "leg odometry of six legs, a joint sample",
        lambda: leg_sample_ms(load_robot("daisy"), WalkKind(100.0, walk_s=8.0)),
    ),
    "legs_4": (
        "leg odometry of four legs, a joint sample",
        lambda: leg_sample_ms(load_robot("go1"), WalkKind(400.0)),
    ),
    "front_end": ("front end, 640 x 480, 150 tracks, a frame, median", lambda: front_end_ms(150)[0]),
    "keyframe": ("window, 150 tracks, 10 keyframes, a keyframe, median", keyframe_ms),
    "vision_frame": ("vision on the bundled sample, a frame, mean", _vision_frame_ms),
}
"""Stages by name: what is counted, and what measures it, ms."""


def measure_bench(
    command: str,
    root: Path,
    *,
    sweeps: Iterable[str] = (),
    endurance_min: float = 0.0,
    rounds: int = 3,
    say: Callable[[str], None] = lambda _: None,
) -> BenchRecord:
    """Measure.

    Args:
        command: that is noted as the origin.
        root: of the checkout.
        sweeps: names out of ``SWEEPS``.
        endurance_min: length of the long inputs, min; 0 for none.
        rounds: repetitions of each stage, the least counts.
        say: gets the name of what is measured next.

    Raises:
        CocloError: a stage fails, or ``root`` is no git checkout.
    """
    say("compilation")
    compiled_s = compile_s()
    unit_ms = MS_PER_S * calibration_s()
    stages = {}
    for name, (what, measure) in STAGES.items():
        say(name)
        ms = min(measure() for _ in range(rounds))
        unit_ms = min(unit_ms, MS_PER_S * calibration_s(trials=1))
        stages[name] = (what, ms)
    say("combined, four legs at 500 Hz, stereo at 15 Hz")
    load = quadruped_with_stereo()
    factor = max(combined_realtime_factor(load) for _ in range(rounds))
    grown = {}
    for name in sweeps:
        say(f"cost by {name}")
        grown[name] = SWEEPS[name]()
    long = {}
    for name, endure in ENDURANCE.items() if endurance_min else ():
        say(f"{endurance_min:g} min of {name}")
        with ProcessPoolExecutor(1, get_context("spawn")) as fresh:  # for its memory
            long[name] = fresh.submit(endure, endurance_min).result()
    return BenchRecord(
        origin=Provenance.now(command, root),
        calibration_ms=unit_ms,
        compile_s=compiled_s,
        stages={name: StageCost(what=what, ms=ms, units=ms / unit_ms) for name, (what, ms) in stages.items()},
        combined_realtime_factor=factor,
        sweeps=grown,
        endurance=long,
    )
