# SPDX-License-Identifier: BSD-3-Clause
"""ATE and RPE are those of the evo command line, to a micrometre."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from coclo_vio.evaluation import metrics
from coclo_vio.evaluation.alignment import align_se3, align_yaw_position
from coclo_vio.geometry import se3, so3
from coclo_vio.values.trajectory import Trajectory, read_tum, write_tum

EVO = Path(sys.executable).parent
pytestmark = pytest.mark.skipif(
    not (EVO / "evo_ape").exists(), reason="evo is not installed beside this Python (extra `dev`)"
)


@pytest.fixture(scope="module")
def pair(tmp_path_factory) -> tuple[Path, Path]:
    """TUM files of a reference and a drifting estimate in a world of its own, with equal stamps."""
    folder = tmp_path_factory.mktemp("tum")
    rng = np.random.default_rng(11)
    heading = np.cumsum(rng.normal(0.0, 0.03, 600))
    steps = 0.02 * np.stack((np.cos(heading), np.sin(heading), 0.2 * np.sin(np.arange(600) / 30.0)), axis=1)
    rotations = Rotation.from_euler("z", heading[:, None]).as_matrix()
    reference = Trajectory(
        1_700_000_000 * 10**9 + np.arange(600) * 50_000_000, se3.transform(rotations, np.cumsum(steps, axis=0))
    )
    noise = Rotation.from_rotvec(np.cumsum(rng.normal(0.0, 0.002, (600, 3)), axis=0)).as_matrix()
    positions = np.cumsum(1.02 * steps + rng.normal(0.0, 0.001, (600, 3)), axis=0)
    estimate = Trajectory(reference.stamps_ns, se3.transform(noise @ rotations, positions))
    write_tum(reference, folder / "reference.tum")
    write_tum(estimate.moved(se3.exp(np.array([0.02, -0.03, 1.0, 3.0, -2.0, 0.5]))), folder / "estimate.tum")
    return folder / "reference.tum", folder / "estimate.tum"


def evo(command: str, reference: Path, estimate: Path, *options: str) -> dict[str, float]:
    """The statistics that evo prints; its settings go to a folder of the test."""
    environment = {**os.environ, "HOME": str(reference.parent), "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [str(EVO / command), "tum", str(reference), str(estimate), *options],
        capture_output=True, text=True, check=True, timeout=120, env=environment,
    )  # fmt: skip
    found = re.findall(r"^\s*(max|mean|median|min|rmse|sse|std)\s+([-+.\deE]+)\s*$", done.stdout, re.MULTILINE)
    return {name: float(value) for name, value in found}


def test_ate_without_alignment(pair):
    reference, estimate = (read_tum(path) for path in pair)
    assert metrics.ate_m(estimate, reference) == pytest.approx(evo("evo_ape", *pair)["rmse"], abs=1e-6)


def test_ate_with_se3_alignment(pair):
    reference, estimate = (read_tum(path) for path in pair)
    ours = metrics.ate_m(estimate.moved(align_se3(estimate, reference)), reference)
    assert ours == pytest.approx(evo("evo_ape", *pair, "--align")["rmse"], abs=1e-6)
    assert ours > 0.01


def test_ate_with_yaw_alignment_is_evos_of_the_aligned_file(pair, tmp_path):
    reference, estimate = (read_tum(path) for path in pair)
    aligned = estimate.moved(align_yaw_position(estimate, reference))
    write_tum(aligned, tmp_path / "aligned.tum")
    ours = metrics.ate_m(aligned, reference)
    assert ours == pytest.approx(evo("evo_ape", pair[0], tmp_path / "aligned.tum")["rmse"], abs=1e-6)
    for yaw in (-1e-3, 1e-3):
        centre = aligned.positions.mean(axis=0)
        R = so3.about_z(yaw)
        assert metrics.ate_m(aligned.moved(se3.transform(R, centre - R @ centre)), reference) > ours


def test_ate_in_the_plane(pair):
    reference, estimate = (read_tum(path) for path in pair)
    evos = evo("evo_ape", *pair, "--project_to_plane", "xy")["rmse"]
    assert metrics.ate_planar_m(estimate, reference) == pytest.approx(evos, abs=1e-6)


def test_rpe_over_one_metre_of_reference_travel(pair):
    reference, estimate = (read_tum(path) for path in pair)
    steps = np.linalg.norm(np.diff(reference.positions, axis=0), axis=1)
    pairs = metrics.segments(np.append(0.0, np.cumsum(steps)), 1.0)
    errors = metrics.relative_errors_m(estimate, reference, pairs)
    evos = evo("evo_rpe", *pair, "--delta", "1", "--delta_unit", "m", "--all_pairs", "--pairs_from_reference")
    assert np.median(errors) == pytest.approx(evos["median"], abs=1e-6)
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(evos["rmse"], abs=1e-6)
    assert errors.max() == pytest.approx(evos["max"], abs=1e-6)
