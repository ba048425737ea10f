# SPDX-License-Identifier: BSD-3-Clause
import inspect

import pytest

from coclo_vio.values import errors
from coclo_vio.values.errors import CocloError, listing

_ERRORS = [value for value in vars(errors).values() if inspect.isclass(value) and issubclass(value, Exception)]


@pytest.mark.parametrize("error", _ERRORS)
def test_one_except_clause_catches_them_all(error: type[Exception]) -> None:
    assert issubclass(error, CocloError)


def test_what_a_recording_does_wrong_is_a_dataset_error() -> None:
    for error in (errors.TopicNotFound, errors.TimestampError, errors.CalibrationMissing):
        assert issubclass(error, errors.DatasetError)
    assert not issubclass(errors.ConfigError, errors.DatasetError)


def test_choices_are_listed_in_order_and_not_without_end() -> None:
    assert listing(["b", "a"]) == "a, b"
    assert listing([]) == "none"
    assert listing((f"joint{i:03d}" for i in range(50)), most=2) == "joint000, joint001, ... (50 in all)"
