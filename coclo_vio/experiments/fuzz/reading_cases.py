# SPDX-License-Identifier: BSD-3-Clause
"""One input of each kind: how it is made from a sound one, and how it is read."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from operator import methodcaller
from pathlib import Path
from typing import Any

import numpy as np
from numpy.random import Generator

from coclo_vio.datasets import euroc_sensor
from coclo_vio.datasets.columns import ColumnNames
from coclo_vio.datasets.config import DatasetConfig
from coclo_vio.datasets.dataset import guess_robot, open_dataset
from coclo_vio.datasets.ground_truth import read_ground_truth
from coclo_vio.datasets.images import encoded
from coclo_vio.datasets.kalibr import read_camchain, read_imu
from coclo_vio.datasets.read_report import ReadTally
from coclo_vio.experiments.fuzz.message_mutations import write_odd_bag
from coclo_vio.experiments.fuzz.mutations import bytes_changed, text_changed
from coclo_vio.robot.description import RobotDescription, load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.runs.inspection import inspect_recording
from coclo_vio.runs.run_config import resolve
from coclo_vio.values.config import parse_settings
from coclo_vio.values.measurements import ALL_SENSORS
from coclo_vio.values.trajectory import read_tum

Seeds = Mapping[str, Sequence[bytes]]
Reading = Callable[[], Any]
_SUFFIX = {"bag": ".bag", "mcap": ".mcap", "db3": ".db3"}
_NAMES = {"tum": "estimate.tum", "truth_csv": "groundtruth.csv", "leg_log": "leg_log.csv", "urdf": "robot.urdf"}
_CORPUS = ("bag", "mcap", "db3", "metadata")


@dataclass(frozen=True, slots=True)
class Case:
    """An input on disk.

    Attributes:
        kind: one of ``KINDS``.
        path: the changed file or folder.
        readings: what is done with it, by name; each is to succeed or to raise one of the package's errors.
    """

    kind: str
    path: Path
    readings: Mapping[str, Reading]


WEIGHTS: Mapping[str, int] = {
    "bag": 17, "mcap": 13, "db3": 9, "metadata": 1, "odd_bag": 4, "odd_mcap": 3, "odd_db3": 1,
    "configuration": 6, "settings": 2, "camchain": 7, "kalibr_imu": 4, "sensor": 7, "robot": 7, "urdf": 4, "tum": 7,
    "truth_csv": 5, "leg_log": 5, "euroc": 3,
}  # fmt: skip
"""The kinds of inputs, and their weights: bags are nearly half."""


def make_case(number: int, seed: int, seeds: Seeds, folder: Path) -> Case:
    """The input of a number, the same for the same seed, written into ``folder``."""
    rng = np.random.default_rng([seed, number])
    kinds, weights = list(WEIGHTS), np.array(list(WEIGHTS.values()), dtype=np.float64)
    kind = str(rng.choice(kinds, p=weights / weights.sum()))
    if kind.startswith("odd_"):
        path = folder / f"walk.{kind.removeprefix('odd_')}"
        write_odd_bag(rng, path)
        return Case(kind, path, dict(_of_recording(rng, path)))
    data = seeds[kind if kind != "settings" else "configuration"]
    sound = data[int(rng.integers(len(data)))]
    if kind in _SUFFIX:
        path = folder / f"walk{_SUFFIX[kind]}"
        others = [each for other in _CORPUS for each in seeds[other]]
        path.write_bytes(bytes_changed(rng, sound, others))
        return Case(kind, path, dict(_of_recording(rng, path)))
    changed = text_changed(rng, sound, [each for group in seeds.values() for each in group])
    if kind == "euroc":
        return Case(kind, folder / "walk", dict(_of_recording(rng, _euroc_folder(rng, folder / "walk", seeds))))
    if kind == "metadata":
        path = folder / "walk"
        path.mkdir()
        (path / "metadata.yaml").write_bytes(changed)
        (path / "walk.db3").write_bytes(seeds["db3"][0])
        return Case(kind, path, dict(_of_recording(rng, path)))
    path = folder / _NAMES.get(kind, f"{kind}.yaml")
    path.write_bytes(changed)
    return Case(kind, path, dict(_of_file(kind, path, seeds, rng)))


def _euroc_folder(rng: Generator, path: Path, seeds: Seeds) -> Path:
    """A small EuRoC folder, one or two of whose files are changed."""
    picture = encoded(np.arange(48, dtype=np.uint8).reshape(6, 8), "png")
    images = "#timestamp [ns],filename\n" + "".join(f"{i * 50_000_000},{i}.png\n" for i in range(5))
    files = {f"{sensor}/{name}": data[0] for sensor, name, data in (
        ("imu0", "sensor.yaml", seeds["sensor"]),
        ("cam0", "sensor.yaml", seeds["sensor"]),
        ("cam1", "sensor.yaml", seeds["sensor"]),
        ("imu0", "data.csv", seeds["euroc"]),
        ("state_groundtruth_estimate0", "data.csv", seeds["truth_csv"]),
    )}  # fmt: skip
    files |= {f"{camera}/data.csv": images.encode() for camera in ("cam0", "cam1")}
    files |= {f"{camera}/data/{i}.png": picture for camera in ("cam0", "cam1") for i in range(5)}
    names = list(files)
    for _ in range(int(rng.integers(1, 3))):
        name = names[int(rng.integers(len(names)))]
        files[name] = text_changed(rng, files[name], [picture])
    for name, data in files.items():
        target = path / "mav0" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(data)
    return path


def _of_recording(rng: Generator, path: Path) -> Iterator[tuple[str, Reading]]:
    """Opening and everything that a dataset offers; or its inspection."""
    config = DatasetConfig(allow_partial=bool(rng.random() < 0.6), sort=bool(rng.random() < 0.1))
    robot = _robot() if rng.random() < 0.8 else None
    if rng.random() < 0.15:
        yield "guess_robot", partial(guess_robot, path, config)
        yield "inspect", lambda: json.dumps(inspect_recording(path, robot, config).to_json())
        return
    opened: list[Any] = []
    yield "open", lambda: opened.append(open_dataset(path, robot, config))

    def of_opened(read: Callable[[Any], Any]) -> Any:
        return read(opened[0]) if opened else None

    for name in ("imu_calibration", "camera_imu_calibration", "stereo_calibration", "ground_truth"):
        yield name, partial(of_opened, methodcaller(name))
    yield "measurements", partial(of_opened, lambda dataset: sum(1 for _ in dataset.measurements(ALL_SENSORS)))
    yield "report", partial(of_opened, methodcaller("report"))


@lru_cache
def _robot() -> RobotDescription:
    return load_robot("go1")


def _of_file(kind: str, path: Path, seeds: Seeds, rng: Generator) -> Iterator[tuple[str, Reading]]:
    match kind:
        case "configuration":
            robot, settings = (None, []) if rng.random() < 0.7 else ("go1", ["dataset.gap_s=0.3"])
            yield "resolve", partial(resolve, robot, path, settings)
        case "settings":
            lines = [line.strip().replace(": ", "=", 1) for line in path.read_text("utf-8", "replace").split("\n")]
            chosen = [line for line in lines if "=" in line and rng.random() < 0.2]
            yield "parse_settings", partial(parse_settings, chosen)
            yield "resolve with settings", partial(resolve, "go1", None, chosen)
        case "camchain":
            yield "read_camchain", partial(read_camchain, path)
        case "kalibr_imu":
            yield "read_imu", partial(read_imu, path)
        case "sensor":
            yield "sensor of an IMU", partial(euroc_sensor.read_imu, path)
            yield "sensors of cameras", partial(euroc_sensor.read_stereo, path, path)
        case "robot" | "urdf":
            other = path.with_name("robot.yaml" if kind == "urdf" else "robot.urdf")
            other.write_bytes(seeds["robot" if kind == "urdf" else "urdf"][0])
            yield "load_robot", lambda: RobotModel(load_robot(path.with_name("robot.yaml")))
        case "tum":
            yield "read_tum", partial(read_tum, path)
        case "truth_csv":
            yield "read_ground_truth", lambda: read_ground_truth(path, ColumnNames(), ReadTally("csv", 0.1))
        case "leg_log":
            yield from _of_recording(rng, path)
