# SPDX-License-Identifier: BSD-3-Clause
"""The command ``simulate``. MuJoCo is an extra: what needs it is imported when the command runs."""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from coclo_vio.cli.extras import check_simulator
from coclo_vio.cli.options import ConfigOption
from coclo_vio.cli.terminal import err, give, say
from coclo_vio.values.config import parse_settings, read_yaml
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.units import BYTES_PER_MB

if TYPE_CHECKING:
    from coclo_vio.simulation.trial.trial import Trial

TrialArgument = Annotated[
    Literal["flat", "ramp", "stairs"],  # as in the simulation's TerrainName
    typer.Argument(help="6 m square with back and forth; ramp of 16.35 deg; 5 steps of 0.6 m x 0.15 m."),
]
PathOption = Annotated[Path, typer.Option("--output", "-o", help="Recording to write: .bag, .mcap, .db3, or a folder.")]
SeedOption = Annotated[int, typer.Option(min=0, help="Decides everything random; the same gives the same bytes.")]
FormatOption = Annotated[
    Literal["euroc", "ros1", "mcap", "ros2"] | None,
    typer.Option("--format", help="By the suffix of the path if not given; a folder is euroc unless it is ros2."),
]
IdealOption = Annotated[bool, typer.Option("--ideal", help="A robot that is exactly as described.")]
ImagesOption = Annotated[bool, typer.Option("--images/--no-images", help="Whether the cameras record.")]
FrictionOption = Annotated[float | None, typer.Option(help="Coulomb coefficient of feet on the ground.")]
TileOption = Annotated[
    float | None,
    typer.Option("--slippery-tile", metavar="MU", help="Coulomb coefficient of a tile 1 m long amid the way: 0.3."),
]
ShockOption = Annotated[
    float | None, typer.Option("--shock-scale", help="Factor on the shocks that the camera's accelerometer feels.")
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
TextureOption = Annotated[Literal["rich", "normal", "poor"] | None, typer.Option(help="How much there is to see.")]
DurationOption = Annotated[float | None, typer.Option(min=1.0, help="Cut the trial short after so many seconds.")]
EncodingOption = Annotated[
    Literal["png", "jpeg"] | None, typer.Option(help="png keeps every bit, jpeg is a third as large.")
]
WorkersOption = Annotated[int | None, typer.Option(min=1, help="Processes that draw; one for each core if not given.")]
SettingOption = Annotated[list[str] | None, typer.Option("--set", help="One value: trial.gait.speed_mps=0.05.")]


def simulate(
    trial: TrialArgument,
    output: PathOption,
    seed: SeedOption = 0,
    format_: FormatOption = None,
    ideal: IdealOption = False,
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
    config: ConfigOption = None,
    settings: SettingOption = None,
) -> None:
    """Simulate one of the paper's trials: a Daisy walks, sees and is watched by Vicon; the truth is kept apart."""
    check_simulator("simulating", "sim")
    from coclo_vio.simulation import simulated_recording as laboratory  # noqa: PLC0415 -- an extra

    given, asked = read_yaml(config) if config else {}, parse_settings(settings or ())
    chosen = {
        "trial": {
            "body": _told(friction=friction, foot_radius_m=foot_radius),
            "camera_imu": _told(shock_scale=shock_scale),
            **_told(slippery_tile=slippery_tile),
        },
        "scene": _told(texture=texture),
        "camera": _told(encoding=image_encoding) | {"lighting": _lighting(lighting, blackout or ())},
    }
    resolved = laboratory.simulation_config(trial, given, laboratory.IDEAL_ROBOT if ideal else {}, asked, chosen)
    if gait_speed != 1.0:
        resolved = laboratory.at_gait_speed(resolved, gait_speed)
    with _progress_bars() as (walked, drawn):
        simulated = laboratory.simulate_recording(
            output,
            trial,
            resolved,
            seed,
            kind=laboratory.RecordingFormat(format_) if format_ else None,
            images=images,
            until_s=duration,
            workers=workers or os.cpu_count() or 1,
            progress=laboratory.Progress(walked, drawn),
        )
    came_m = laboratory.walked_m(simulated.truth.trajectory)
    frames = len(simulated.frame_ns) if images else 0
    _give_summary(simulated, output, laboratory.truth_folder(output), came_m, frames)


def _told(**values: Any) -> dict[str, Any]:
    """Those options that the user has given."""
    return {name: value for name, value in values.items() if value is not None}


def _lighting(level: str | None, blackouts: Sequence[str]) -> dict[str, Any]:
    return _told(level=level, blackouts=[_blackout(text) for text in blackouts] or None)


def _blackout(text: str) -> dict[str, float]:
    start, _, seconds = text.partition(":")
    try:
        return {"start_s": float(start), "duration_s": float(seconds)}
    except ValueError as error:
        raise ConfigError(f"--blackout takes START:SECONDS, such as 20:3 for three seconds, got {text!r}") from error


@contextmanager
def _progress_bars() -> Iterator[tuple[Callable[[float, float], None], Callable[[int, int], None]]]:
    """A bar for walking and one for drawing, each from its first news on."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f} / {task.total:.0f} {task.fields[unit]}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        tasks: dict[str, TaskID] = {}

        def tell(what: str, unit: str, done: float, total: float) -> None:
            if what not in tasks:
                tasks[what] = bar.add_task(what, unit=unit)
            bar.update(tasks[what], completed=done, total=max(done, total))

        try:
            yield partial(tell, "walking", "s"), partial(tell, "drawing", "frames")
        except KeyboardInterrupt:
            say("stopped; nothing was written")
            raise


def _give_summary(trial: "Trial", recording: Path, truth: Path, walked_m: float, frames: int) -> None:
    duration_s, way_m = trial.truth.trajectory.duration_s, trial.terrain.path_length_m
    drawn = f", {frames} stereo frames" if frames else ""
    give(f"recording: {recording} ({_size_mb(recording):.1f} MB)")
    give(f"truth, which no estimator may read: {truth} ({_size_mb(truth):.1f} MB)")
    give(f"{duration_s:.1f} s, {walked_m:.2f} m walked of a way of {way_m:.2f} m{drawn}")


def _size_mb(path: Path) -> float:
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file()) / BYTES_PER_MB
