# SPDX-License-Identifier: BSD-3-Clause
"""The command ``simulate``. MuJoCo is an extra: what needs it is imported when the command runs."""

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from coclo_vio.cli.extras import check_simulator
from coclo_vio.cli.options import ConfigOption
from coclo_vio.cli.stopping import stoppable
from coclo_vio.cli.terminal import err, give
from coclo_vio.values.config import parse_settings, read_yaml
from coclo_vio.values.errors import ConfigError, listing
from coclo_vio.values.units import BYTES_PER_MB

if TYPE_CHECKING:
    from coclo_vio.simulation.trial.trial import Trial

TrialArgument = Annotated[
    Literal["flat", "ramp", "stairs", "trot"],  # as in the simulation's TerrainName, and a quadruped's trot
    typer.Argument(
        help="Daisy: 6 m square with back and forth; ramp of 16.35 deg; 5 steps of 0.6 m x 0.15 m. Quadruped: trot."
    ),
]
PathOption = Annotated[Path, typer.Option("--output", "-o", help="Recording to write: .bag, .mcap, .db3, or a folder.")]
SeedOption = Annotated[int, typer.Option(min=0, help="Of everything random; the same seed makes the same bytes.")]
FormatOption = Annotated[
    Literal["euroc", "ros1", "mcap", "ros2"] | None,
    typer.Option("--format", help="By the suffix of the path if not given; a folder is euroc unless it is ros2."),
]
IdealOption = Annotated[bool, typer.Option("--ideal", help="A robot that equals its description.")]
ConditionOption = Annotated[
    list[str] | None,
    typer.Option("--condition", metavar="NAME", help="A condition of legs, vision or IMUs by name; may be repeated."),
]
ImagesOption = Annotated[bool, typer.Option("--images/--no-images", help="Whether the cameras record.")]
FrictionOption = Annotated[float | None, typer.Option(help="Coulomb coefficient of feet on the ground.")]
TileOption = Annotated[
    float | None,
    typer.Option("--slippery-tile", metavar="MU", help="Coulomb coefficient of a tile of 1 m beside the path: 0.3."),
]
ShockOption = Annotated[
    float | None, typer.Option("--shock-scale", help="Factor on the shocks measured by the camera's accelerometer.")
]
FootRadiusOption = Annotated[
    float | None, typer.Option(help="Radius of the feet, m; the estimators' description keeps its own.")
]
GaitSpeedOption = Annotated[float, typer.Option(min=0.1, max=5.0, help="Factor on speed and steps a second.")]
LightingOption = Annotated[Literal["normal", "dark"] | None, typer.Option(help="Light in the room.")]
BlackoutOption = Annotated[
    list[str] | None,
    typer.Option(metavar="START:SECONDS", help="No light from START on, s after the first image; may be repeated."),
]
TextureOption = Annotated[Literal["rich", "normal", "poor"] | None, typer.Option(help="Amount of visual texture.")]
DurationOption = Annotated[float | None, typer.Option(min=1.0, help="Cut the trial short after so many seconds.")]
EncodingOption = Annotated[
    Literal["png", "jpeg"] | None, typer.Option(help="png keeps every bit, jpeg is a third as large.")
]
WorkersOption = Annotated[int | None, typer.Option(min=1, help="Rendering processes; one for each core if not given.")]
RobotOption = Annotated[
    Literal["go1", "go2", "a1", "anymal_b"] | None,  # as in the simulation's QuadrupedName
    typer.Option("--robot", help="Of trot: the quadruped; go1 if not given."),
]
GroundOption = Annotated[
    Literal["flat", "rough", "ramp", "stairs", "slippery"] | None,  # as in the simulation's GroundName
    typer.Option("--ground", help="Of trot: what the quadruped trots on; flat if not given."),
]
SpeedOption = Annotated[
    float | None, typer.Option("--speed", min=0.1, max=2.0, help="Of trot, m/s: 0.3 to 1.2; 0.6 if not given.")
]
SettingOption = Annotated[list[str] | None, typer.Option("--set", help="One value: trial.gait.speed_mps=0.05.")]


def simulate(
    trial: TrialArgument,
    output: PathOption,
    seed: SeedOption = 0,
    format_: FormatOption = None,
    ideal: IdealOption = False,
    condition: ConditionOption = None,
    images: ImagesOption = True,
    friction: FrictionOption = None,
    slippery_tile: TileOption = None,
    foot_radius: FootRadiusOption = None,
    shock_scale: ShockOption = None,
    gait_speed: GaitSpeedOption = 1.0,
    lighting: LightingOption = None,
    blackout: BlackoutOption = None,
    texture: TextureOption = None,
    duration: DurationOption = None,
    image_encoding: EncodingOption = None,
    workers: WorkersOption = None,
    robot: RobotOption = None,
    ground: GroundOption = None,
    speed: SpeedOption = None,
    config: ConfigOption = None,
    settings: SettingOption = None,
) -> None:
    """Simulate a trial: a robot walks, records and is tracked by Vicon; the truth is kept apart.

    The paper's trials are those of a Daisy; ``trot`` is a quadruped's.
    """
    check_simulator("simulating", "sim")
    from coclo_vio.simulation import simulated_recording as simulator  # noqa: PLC0415 -- an extra
    from coclo_vio.simulation.conditions import condition_changes  # noqa: PLC0415

    from_file, from_settings = read_yaml(config) if config else {}, parse_settings(settings or ())
    from_options = {
        "trial": {
            "body": _given(friction=friction, foot_radius_m=foot_radius),
            "camera_imu": _given(shock_scale=shock_scale),
            **_given(slippery_tile=slippery_tile),
        },
        "scene": _given(texture=texture),
        "camera": _given(encoding=image_encoding) | {"lighting": _lighting(lighting, blackout or ())},
    }
    conditions = condition_changes(condition or ())
    changes = (from_file, simulator.IDEAL_ROBOT if ideal else {}, *conditions, from_settings, from_options)
    kind = simulator.RecordingFormat(format_) if format_ else None
    of_trot = {"--robot": robot, "--ground": ground, "--speed": speed}
    if trial == "trot":
        _check_options(
            {"--gait-speed": gait_speed if gait_speed != 1.0 else None, "--slippery-tile": slippery_tile}, trial
        )
        start = partial(_start_trot, output, _given(robot=robot, ground=ground), speed, changes)
    else:
        _check_options(of_trot, trial)
        resolved = simulator.at_gait_speed(simulator.simulation_config(trial, *changes), gait_speed)
        start = partial(simulator.simulate_recording, output, trial, resolved)
    nothing = ("nothing was written: the same command simulates the same trial from its beginning",)
    with stoppable(lambda: nothing), _progress_bars() as (on_simulated, on_rendered):
        execution = simulator.Execution(workers or os.cpu_count() or 1, on_simulated, on_rendered)
        simulated = start(seed, recording_format=kind, images=images, until_s=duration, execution=execution)
    _give_summary(simulated, output, frames=len(simulated.frame_ns) if images else 0)


def _start_trot(
    output: Path,
    chosen: Mapping[str, Any],
    speed_mps: float | None,
    changes: Sequence[Mapping[str, Any]],
    seed: int,
    **how: Any,
) -> "Trial":
    """Simulate a quadruped's trot; ``chosen`` are robot and ground, ``how`` goes to ``simulate_trot``."""
    from coclo_vio.simulation import simulated_trot as simulator  # noqa: PLC0415 -- an extra

    of_options = {"trial": {**chosen, "gait": _given(speed_mps=speed_mps)}}
    return simulator.simulate_trot(output, simulator.trot_config(*changes, of_options), seed, **how)


def _check_options(options: Mapping[str, Any], trial: str) -> None:
    """See that no option is given that the trial does not have."""
    given = [name for name, value in options.items() if value is not None]
    if given:
        raise ConfigError(f"the trial {trial} has no {listing(given)}; leave it out, or choose a trial that has it")


def _given(**values: Any) -> dict[str, Any]:
    """The options that the user has set."""
    return {name: value for name, value in values.items() if value is not None}


def _lighting(level: str | None, blackouts: Sequence[str]) -> dict[str, Any]:
    return _given(level=level, blackouts=[_blackout(text) for text in blackouts] or None)


def _blackout(text: str) -> dict[str, float]:
    start, _, seconds = text.partition(":")
    try:
        return {"start_s": float(start), "duration_s": float(seconds)}
    except ValueError as error:
        raise ConfigError(f"--blackout takes START:SECONDS, such as 20:3 for three seconds, got {text!r}") from error


@contextmanager
def _progress_bars() -> Iterator[tuple[Callable[[float, float], None], Callable[[int, int], None]]]:
    """A bar for the simulation and one for the rendering, each from its first progress on."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f} / {task.total:.0f} {task.fields[unit]}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        tasks: dict[str, TaskID] = {}

        def update(task: str, unit: str, done: float, total: float) -> None:
            if task not in tasks:
                tasks[task] = bar.add_task(task, unit=unit)
            bar.update(tasks[task], completed=done, total=max(done, total))

        yield partial(update, "simulating", "s"), partial(update, "rendering", "frames")


def _give_summary(trial: "Trial", recording: Path, *, frames: int) -> None:
    from coclo_vio.simulation.simulated_recording import truth_folder, walked_m  # noqa: PLC0415 -- an extra

    truth, trajectory = truth_folder(recording), trial.truth.trajectory
    rendered = f", {frames} stereo frames" if frames else ""
    give(f"recording: {recording} ({_size_mb(recording):.1f} MB)")
    give(f"truth, which no estimator may read: {truth} ({_size_mb(truth):.1f} MB)")
    give(
        f"{trajectory.duration_s:.1f} s, {walked_m(trajectory):.2f} m walked of a path of "
        f"{trial.terrain.path_length_m:.2f} m{rendered}"
    )


def _size_mb(path: Path) -> float:
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file()) / BYTES_PER_MB
