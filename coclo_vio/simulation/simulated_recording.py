# SPDX-License-Identifier: BSD-3-Clause
"""A simulated trial on the disk: the recording, and its truth in a folder that no reader opens.

Both appear under their names only when they are complete. Imports MuJoCo: import this module only to simulate.
"""

import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from pydantic import Field

from coclo_vio import __version__
from coclo_vio.datasets.recording_contents import RecordingContents
from coclo_vio.datasets.rosbag.writing.bag_writer import write_bag
from coclo_vio.datasets.writer import ALL_JOINT_READINGS, RecordedJoints, write_euroc_folder
from coclo_vio.robot.description import RobotDescription, load_robot
from coclo_vio.simulation.trial.config import TrialConfig, preset
from coclo_vio.simulation.trial.gait_controller import planned_path
from coclo_vio.simulation.trial.imperfection import IDEAL
from coclo_vio.simulation.trial.terrain import TerrainName, make_terrain
from coclo_vio.simulation.trial.trial import Trial, Truth, simulate
from coclo_vio.simulation.visuals.cameras import add_cameras
from coclo_vio.simulation.visuals.config import CameraConfig, SceneConfig
from coclo_vio.simulation.visuals.opengl import choose_backend
from coclo_vio.simulation.visuals.scene import add_visuals
from coclo_vio.simulation.visuals.stereo_renderer import render_stereo
from coclo_vio.values.config import StageConfig, merged, write_yaml
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.measurements import EncodedStereoFrame
from coclo_vio.values.script_guard import refuse_while_imported
from coclo_vio.values.trajectory import Trajectory, write_tum
from coclo_vio.values.units import NS_PER_S

SIMULATED_ROBOT = "daisy"
IDEAL_ROBOT: Mapping[str, Any] = {"trial": {"imperfection": IDEAL.model_dump()}}  # equal to its description


class RecordingFormat(Enum):
    """How a trial is stored."""

    EUROC = "euroc"
    ROS1 = "ros1"
    MCAP = "mcap"
    ROS2 = "ros2"

    @classmethod
    def of(cls, path: Path, choice: "RecordingFormat | None" = None) -> "RecordingFormat":
        """The format of a path: the choice, or by the suffix; a path without suffix is an EuRoC-style folder.

        Raises:
            DatasetError: no name, a suffix that no format has, or one that the chosen format does not have.
        """
        if not path.name:
            raise DatasetError(f"{path} is no name for a recording; name a new file or folder, such as flat.mcap")
        candidates = [kind for kind, suffixes in _SUFFIXES.items() if path.suffix in suffixes]
        if not candidates:
            raise DatasetError(
                f"{path} ends in {path.suffix}, which no format has; end it in .bag (ROS 1), .mcap or .db3 (ROS 2), or "
                "in nothing for a folder (EuRoC-style, or a bag of ROS 2 with --format ros2)"
            )
        if choice is not None and choice not in candidates:
            endings = " or ".join(suffix or "nothing" for suffix in _SUFFIXES[choice])
            raise DatasetError(
                f"{path} cannot be written as {choice.value}, which ends in {endings}; change one of them"
            )
        return choice or candidates[0]


_SUFFIXES: Mapping[RecordingFormat, tuple[str, ...]] = {
    RecordingFormat.EUROC: ("",),
    RecordingFormat.ROS1: (".bag",),
    RecordingFormat.MCAP: (".mcap",),
    RecordingFormat.ROS2: (".db3", ""),
}


class SimulationConfig(StageConfig):
    """Configuration of a simulated recording: the trial, the room, the cameras."""

    trial: Annotated[TrialConfig, Field(description="robot, gait, physics, sensors, motion capture")] = TrialConfig()
    scene: Annotated[SceneConfig, Field(description="the room")] = SceneConfig()
    camera: Annotated[CameraConfig, Field(description="imagers, exposure, light, encoding")] = CameraConfig()


@dataclass(frozen=True, slots=True)
class Execution:
    """How a simulation is carried out; no result depends on it.

    Attributes:
        workers: number of rendering processes.
        on_simulated: called with the simulated time and its planned end, s.
        on_rendered: called with the number of rendered stereo frames and their total.
        motions: folder of true motions, which recordings that differ in their sensors only share; None: none is kept.
    """

    workers: int = 2
    on_simulated: Callable[[float, float], None] = lambda time_s, planned_s: None
    on_rendered: Callable[[int, int], None] = lambda done, total: None
    motions: Path | None = None


def simulation_config(name: TerrainName, *changes: Mapping[str, Any]) -> SimulationConfig:
    """The configuration of one of the paper's trials with changes such as ``IDEAL_ROBOT``; later ones win.

    Raises:
        ConfigError: a key that does not exist, or a value out of bounds.
    """
    values: dict[str, Any] = {"trial": preset(name)}
    for change in changes:
        values = merged(values, change)
    return SimulationConfig.parse(values, f"trial {name}")


def at_gait_speed(config: SimulationConfig, factor: float) -> SimulationConfig:
    """The same trial with the speeds times ``factor`` and the gait's period divided by it.

    Raises:
        ConfigError: the gait's speeds leave their bounds.
    """
    gait = config.trial.gait
    faster = {
        "speed_mps": gait.speed_mps * factor,
        "turn_rate_radps": gait.turn_rate_radps * factor,
        "period_s": gait.period_s / factor,
    }
    return SimulationConfig.parse(merged(config.model_dump(), {"trial": {"gait": faster}}), f"gait speed {factor}")


def simulate_recording(
    path: Path,
    name: TerrainName,
    config: SimulationConfig,
    seed: int,
    *,
    recording_format: RecordingFormat | None = None,
    images: bool = True,
    until_s: float | None = None,
    execution: Execution | None = None,
) -> Trial:
    """Simulate a trial and write it to ``path``, and its truth to ``truth_folder(path)``.

    Args:
        path: of the recording; must not exist, nor the folder of its truth.
        name: the terrain.
        config: the simulation.
        seed: decides everything random; on one machine the same seed makes the same bytes.
        recording_format: by the suffix of ``path`` if None.
        images: whether the cameras record.
        until_s: end of the simulation if the trial is not over before, s.
        execution: number of processes and callbacks of progress.

    Raises:
        DatasetError: a path exists, cannot be written, or does not fit the format.
        SimulationError: the robot fell, or there is no OpenGL to render with.
    """
    robot = load_robot(SIMULATED_ROBOT)
    plan = Plan(
        name=name,
        robot=robot,
        config=config,
        scene=config.scene,
        camera=config.camera,
        seed=seed,
        planned_s=min(_planned_duration_s(name, config.trial), until_s or np.inf),
        make=lambda progress, motions: simulate(
            name, robot, config.trial, seed, until_s=until_s, progress=progress, motions=motions
        ),
    )
    return record(path, plan, recording_format=recording_format, images=images, execution=execution)


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """What is to be simulated and recorded.

    Attributes:
        name: of the trial.
        robot: the described robot.
        config: the whole configuration, kept with the truth.
        scene: its room.
        camera: its imagers.
        seed: decides everything random.
        planned_s: duration of the trial if nothing delays it.
        make: simulates the trial, given a callback of progress and a folder of motions.
        joints: which of the joints' readings are recorded.
    """

    name: str
    robot: RobotDescription
    config: StageConfig
    scene: SceneConfig
    camera: CameraConfig
    seed: int
    planned_s: float
    make: Callable[[Callable[[float], None], Path | None], Trial]
    joints: RecordedJoints = ALL_JOINT_READINGS


def record(
    path: Path,
    plan: Plan,
    *,
    recording_format: RecordingFormat | None = None,
    images: bool = True,
    execution: Execution | None = None,
) -> Trial:
    """Simulate what is planned and write it to ``path``, and its truth to ``truth_folder(path)``.

    Raises:
        DatasetError: a path exists, cannot be written, or does not fit the format.
        SimulationError: the robot fell, or there is no OpenGL to render with.
        CocloError: called by a script without ``if __name__ == "__main__":``, in a process that renders for it.
    """
    refuse_while_imported("a simulation")
    recording_format = RecordingFormat.of(path, recording_format)
    execution = execution or Execution()
    on_simulated, planned_s = execution.on_simulated, plan.planned_s
    with _atomic_outputs(path, truth_folder(path)) as scratch:
        if images:
            choose_backend()  # fails before the simulation, not after it
        trial = plan.make(lambda time_s: on_simulated(time_s, planned_s), execution.motions)
        frames = _frames(trial, plan, scratch / "model.mjb", execution) if images else ()
        _write(scratch / path.name, recording_format, _contents(trial, plan.robot, frames, images=images), plan.joints)
        _write_truth(scratch / truth_folder(path).name, trial, plan)
    return trial


def truth_folder(path: Path) -> Path:
    """The folder of the truth of the recording at ``path``: beside it, where no reader opens it."""
    return path.with_name(f"{path.stem}_truth")


def walked_m(trajectory: Trajectory) -> float:
    """Path length of the body in steps of a second, m: sway within a second does not count."""
    seconds = np.arange(trajectory.stamps_ns[0], trajectory.stamps_ns[-1], NS_PER_S)
    steps = np.append(np.searchsorted(trajectory.stamps_ns, seconds), len(trajectory) - 1)
    return trajectory.select(np.unique(steps)).path_length_m()


def _planned_duration_s(name: TerrainName, config: TrialConfig) -> float:
    """Duration of the trial if no swing is late, s."""
    path = planned_path(make_terrain(name), config.gait)
    return config.stand_s + path.duration_s + config.end_s


@contextmanager
def _atomic_outputs(*outputs: Path) -> Iterator[Path]:
    """A scratch folder; its entries with the outputs' names are moved there at the end, or removed after an error."""
    for output in outputs:
        if output.exists():
            raise DatasetError(f"{output} is there already; name another path, or remove it first")
    first = outputs[0]
    try:
        first.parent.mkdir(parents=True, exist_ok=True)
        scratch_folder = tempfile.TemporaryDirectory(prefix=f".{first.name}.", dir=first.parent)
    except OSError as error:
        raise DatasetError(f"cannot write {first}: {error.strerror}; choose another place") from error
    with scratch_folder as scratch:
        yield Path(scratch)
        for output in reversed(outputs):
            try:
                (Path(scratch) / output.name).rename(output)
            except OSError as error:
                raise DatasetError(f"cannot write {output}: {error.strerror}; choose another place") from error


def _frames(trial: Trial, plan: Plan, model_path: Path, execution: Execution) -> Iterable[EncodedStereoFrame]:
    import mujoco  # noqa: PLC0415 -- an extra

    body = trial.spec.bodies[1].name
    add_cameras(trial.spec, trial.truth.stereo, body)
    add_visuals(trial.spec, trial.terrain.surfaces, plan.scene, plan.seed, trial.terrain.bounds)
    mujoco.mj_saveModel(trial.spec.compile(), str(model_path))
    total = len(trial.frame_ns)
    return render_stereo(
        model_path,
        trial.frame_qpos,
        trial.frame_ns,
        plan.camera,
        plan.seed,
        execution.workers,
        lambda done: execution.on_rendered(done, total),
        trial.frame_qvel,
    )


def _contents(
    trial: Trial, robot: RobotDescription, frames: Iterable[EncodedStereoFrame], *, images: bool
) -> RecordingContents:
    stereo = trial.stereo if images else None
    return RecordingContents(robot, trial.measurements, trial.vicon, trial.imu, trial.camera_imu, stereo, frames)


def _write(path: Path, recording_format: RecordingFormat, contents: RecordingContents, joints: RecordedJoints) -> None:
    if recording_format is RecordingFormat.EUROC:
        write_euroc_folder(path, contents, joints=joints)
    else:
        write_bag(path, contents, joints=joints)


def _write_truth(folder: Path, trial: Trial, plan: Plan) -> None:
    """Exact poses, contacts, biases, how the robot differs from its description, and the configuration of it all."""
    truth = trial.truth
    try:
        folder.mkdir()
        write_yaml(plan.config, folder / "config.yaml")
        write_tum(truth.trajectory, folder / "groundtruth.tum")
        _write_contacts(folder / "contacts.csv", trial)
        record = {
            "version": __version__,
            "trial": plan.name,
            "seed": plan.seed,
            "path_length_m": trial.terrain.path_length_m,
            "walked_m": walked_m(truth.trajectory),
            "duration_s": truth.trajectory.duration_s,
            "vicon_clock_ahead_s": truth.vicon_offset_s,
            "legs_touching_each_other": truth.self_contacts,
            "legs_touching_the_ground": truth.ground_contacts,
            "gyroscope_bias_at_start_radps": truth.imu.gyroscope_bias[0].tolist(),
            "accelerometer_bias_at_start_mps2": truth.imu.accelerometer_bias[0].tolist(),
            "stereo": truth.stereo.model_dump(mode="json"),
            "slippery_tile": _tile_record(truth),
            "robot": {key: np.asarray(value).tolist() for key, value in asdict(truth.imperfection).items()},
        }
        (folder / "trial.yaml").write_text(yaml.safe_dump(record, sort_keys=False), encoding="utf-8")
    except OSError as error:
        raise DatasetError(f"cannot write {folder}: {error.strerror}; choose another place") from error


def _tile_record(truth: Truth) -> dict[str, Any] | None:
    """Friction and position of the slippery tile, and the first and last time of a foot on it."""
    tile = truth.tile
    if tile is None:
        return None
    return {
        "friction": tile.friction,
        "place_m": tile.centre.tolist(),
        "heading_rad": tile.heading_rad,
        "feet_on_it_s": None if truth.on_tile_s is None else list(truth.on_tile_s),
    }


def _write_contacts(path: Path, trial: Trial) -> None:
    """True contacts of the feet: a row at the beginning and at every change, exact to the physics' step."""
    contact, stamps = trial.truth.contact, trial.truth.contact_ns
    changes = [0, *(np.flatnonzero((contact[1:] != contact[:-1]).any(axis=1)) + 1)]
    with path.open("w", encoding="ascii", newline="\n") as out:
        out.write(",".join(["stamp_ns", *trial.robot.leg_names]) + "\n")
        for row in changes:
            out.write(",".join([str(int(stamps[row])), *(str(int(value)) for value in contact[row])]) + "\n")
