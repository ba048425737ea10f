# SPDX-License-Identifier: BSD-3-Clause
"""Registration of a keyframe's variables: keys, order, layout of covariances, and letters that clash."""

import numpy as np
import pytest

from coclo_vio.backend.window import factors
from coclo_vio.backend.window.variables import BIASES, LANDMARK, POSE, VELOCITY, KeyframeVariables, Variable

LEG_SCALE = Variable("leg scale", "s", 1)


def test_a_keyframe_has_its_pose_and_what_is_registered_once() -> None:
    variables = KeyframeVariables([VELOCITY, BIASES, VELOCITY])
    assert list(variables) == [POSE, VELOCITY, BIASES]
    assert variables.size == variables.state_size == 15
    assert VELOCITY in variables
    assert LEG_SCALE not in variables


def test_the_pose_is_eliminated_last() -> None:
    keys = KeyframeVariables([VELOCITY, BIASES]).keys(7)
    assert keys == [factors.bias_key(7), factors.velocity_key(7), factors.pose_key(7)]


def test_dimensions_are_known_of_registered_keys_and_of_landmarks() -> None:
    variables = KeyframeVariables([VELOCITY, BIASES, LEG_SCALE])
    assert [variables.dimensions(each.key(3)) for each in (POSE, VELOCITY, BIASES, LEG_SCALE, LANDMARK)] == [
        6,
        3,
        6,
        1,
        3,
    ]


@pytest.mark.parametrize("letter", ["x", "v", "l"])
def test_two_variables_cannot_have_the_same_letter(letter: str) -> None:
    with pytest.raises(ValueError, match="same letter"):
        KeyframeVariables([VELOCITY]).register(Variable("another", letter, 2))


@pytest.mark.parametrize("registered", [[], [VELOCITY, BIASES], [LEG_SCALE], [LEG_SCALE, VELOCITY]])
def test_covariances_are_put_in_the_order_of_pose_velocity_and_the_others(registered: list[Variable]) -> None:
    """Variances are numbered by letter and dimension; a velocity that is no variable is left zero."""
    variables = KeyframeVariables(registered)
    number = {each: 100.0 * index for index, each in enumerate((POSE, VELOCITY, BIASES, LEG_SCALE), start=1)}
    eliminated = [number[each] + row for each in reversed([*variables]) for row in range(each.dimensions)]
    solved = variables.as_registered(np.diag(eliminated))
    assert np.diag(solved).tolist() == [number[each] + row for each in variables for row in range(each.dimensions)]
    state = np.diag(variables.state_covariance(solved))
    assert len(state) == variables.state_size
    assert variables.rows(POSE) == slice(0, 6)
    assert variables.rows(VELOCITY) == slice(6, 9)
    for each in variables:
        assert state[variables.rows(each)].tolist() == [number[each] + row for row in range(each.dimensions)]
    if VELOCITY not in variables:
        assert not state[6:9].any()


def test_rows_of_what_is_not_registered_are_refused() -> None:
    with pytest.raises(ValueError, match="leg scale"):
        KeyframeVariables([VELOCITY]).rows(LEG_SCALE)
