# SPDX-License-Identifier: BSD-3-Clause
"""Modes registered and unregistered in this process, and what derives from them."""

import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from coclo_vio.evaluation.figure_style import style_of
from coclo_vio.evaluation.ranking import rank
from coclo_vio.evaluation.trajectory_roles import fused_pairs, in_order
from coclo_vio.robot.description import load_robot
from coclo_vio.runs.equipment import Equipment
from coclo_vio.runs.evaluating import evaluate_run
from coclo_vio.runs.inspection import inspect_recording
from coclo_vio.runs.mode_choice import compared_modes, default_mode
from coclo_vio.runs.modes.mode import Compared, Mode, Need
from coclo_vio.runs.modes.registry import mode_of, modes, register_mode, unregister_mode
from coclo_vio.runs.run_config import RunConfig, resolve
from coclo_vio.runs.run_figures import draw_figure
from coclo_vio.runs.run_folder import read_record
from coclo_vio.runs.running import run_modes
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.outputs import Estimator
from coclo_vio.values.trajectory_kind import TrajectoryKind, registered_trajectory_kinds, trajectory_kind

CONFIG = resolve("daisy")


def make(equipment: Equipment, config: RunConfig) -> Estimator:
    """The mode naive_rolling, under the toy's name."""
    from coclo_vio.filter.naive import NaiveLegOdometry  # noqa: PLC0415
    from coclo_vio.fusion.leg_odometry import LegOdometry  # noqa: PLC0415

    robot = equipment.require_robot()
    return LegOdometry("toy", NaiveLegOdometry(robot, config.filter, rolls_feet=True, weighs_load=False))


TOY = Mode(
    "toy",
    "for this test",
    frozenset({Need.LEGS}),
    make,
    (TrajectoryKind("toy", "Toy", "#123456", standalone="naive", is_featured=True),),
    rank=15,
    default_rank=-1,
)


@pytest.fixture
def toy() -> Iterator[Mode]:
    register_mode(TOY)
    yield TOY
    unregister_mode("toy")


def test_modes_are_listed_by_rank(toy: Mode) -> None:
    assert mode_of("toy") is toy
    names = list(modes())
    assert names.index("coclo") < names.index("toy") < names.index("vins")
    ranks = [mode.rank for mode in modes().values()]
    assert ranks == sorted(ranks)


def test_an_unknown_mode_lists_the_modes_there_are(toy: Mode) -> None:
    with pytest.raises(ConfigError, match=r"no mode 'cocolo'; the modes are: coclo, coclo_leg_scale, .*toy, vins"):
        mode_of("cocolo")


def test_the_listing_of_modes_cannot_be_changed() -> None:
    with pytest.raises(TypeError):
        modes()["toy"] = TOY  # type: ignore[index]


def test_a_registered_mode_is_inspected_compared_and_the_default(toy: Mode, leg_log: Path) -> None:
    missing = inspect_recording(leg_log, load_robot("daisy"), CONFIG.dataset).missing
    assert missing["toy"] == ()
    assert "toy" in compared_modes(leg_log, CONFIG)
    assert default_mode(leg_log, CONFIG) == "toy"


@pytest.mark.parametrize("compared", [Compared.ON_REQUEST, Compared.WITHOUT_LEGS])
def test_a_mode_can_be_a_default_without_being_compared(compared: Compared, leg_log: Path) -> None:
    register_mode(replace(TOY, compared=compared))
    try:
        assert "toy" not in compared_modes(leg_log, CONFIG)
        assert default_mode(leg_log, CONFIG) == "toy"
    finally:
        unregister_mode("toy")


def test_a_registered_mode_is_ranked_against_its_standalone_mode_and_drawn_in_its_colour(
    toy: Mode, leg_log: Path, tmp_path: Path
) -> None:
    pytest.importorskip("matplotlib")
    run_modes(leg_log, ["naive", "toy"], CONFIG, tmp_path)
    evaluations, failures = evaluate_run(tmp_path, CONFIG.evaluation)
    assert failures == {}
    [ranking] = rank(evaluations, CONFIG.evaluation)
    assert (ranking.subject, ranking.against) == ("toy", "naive")
    assert ranking.sentence.startswith("Toy ")
    figure = draw_figure("path", tmp_path, read_record(tmp_path), evaluations, CONFIG.evaluation)
    lines = {line.get_label(): line.get_color() for axis in figure.axes for line in axis.get_lines()}
    assert lines["toy"] == "#123456"
    [legend] = figure.legends
    labels = [text.get_text() for text in legend.get_texts()]
    assert labels == ["ground truth", "toy", "naive"], "featured trajectories lead"


def test_kinds_of_trajectories_come_and_go_with_their_mode() -> None:
    register_mode(TOY)
    assert fused_pairs()[0] == ("toy", "naive"), "by the rank of its mode"
    assert style_of("toy")["color"] == "#123456"
    assert in_order(["naive", "toy"]) == ["toy", "naive"]
    unregister_mode("toy")
    assert "toy" not in modes()
    assert "toy" not in registered_trajectory_kinds()
    assert ("toy", "naive") not in fused_pairs()
    assert trajectory_kind("toy") == TrajectoryKind("toy")
    unregister_mode("toy")  # a second time changes nothing
    register_mode(TOY)
    unregister_mode("toy")


def test_two_modes_of_one_name_are_refused(toy: Mode) -> None:
    with pytest.raises(ConfigError, match="there is a mode 'toy' already; register yours under another name"):
        register_mode(replace(toy, summary="another"))
    assert mode_of("toy") is toy


@pytest.mark.parametrize("kind", [TrajectoryKind("coclo"), mode_of("coclo").trajectories[0]], ids=["other", "same"])
def test_two_modes_that_give_a_trajectory_of_one_name_are_refused_as_a_whole(kind: TrajectoryKind) -> None:
    """Also where the kinds are equal: both would write the same file of a run folder."""
    clashing = replace(TOY, trajectories=(TrajectoryKind("toy"), kind))
    with pytest.raises(ConfigError, match=r"modes 'coclo' and 'toy' both give a trajectory named 'coclo'; give yours"):
        register_mode(clashing)
    assert "toy" not in modes()
    assert "toy" not in registered_trajectory_kinds()
    assert trajectory_kind("coclo").label == "COCLO"


def test_a_mode_that_is_registered_before_any_other_is_asked_for_cannot_take_a_name_of_the_package() -> None:
    code = (
        "from coclo_vio import Mode, Need, modes, register_mode\n"
        "try:\n"
        "    register_mode(Mode('coclo', '', frozenset({Need.LEGS}), lambda equipment, config: None))\n"
        "except Exception as error:\n"
        "    print(error)\n"
        "print(modes()['coclo'].trajectories[0].label)\n"
    )
    answer = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    assert answer.stdout.splitlines() == [
        "there is a mode 'coclo' already; register yours under another name",
        "COCLO",
    ]
