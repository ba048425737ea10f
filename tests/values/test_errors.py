# SPDX-License-Identifier: BSD-3-Clause
import inspect

import pytest

from coclo_vio.values import errors
from coclo_vio.values.errors import CocloError, listing

_ERRORS = [value for value in vars(errors).values() if inspect.isclass(value) and issubclass(value, Exception)]


@pytest.mark.parametrize("error", _ERRORS)
def test_every_error_is_a_coclo_error(error: type[Exception]) -> None:
    assert issubclass(error, CocloError)


def test_errors_of_recordings_are_dataset_errors() -> None:
    for error in (errors.TopicNotFound, errors.TimestampError, errors.CalibrationMissing):
        assert issubclass(error, errors.DatasetError)
    assert not issubclass(errors.ConfigError, errors.DatasetError)


def test_choices_are_listed_in_order_and_shortened() -> None:
    assert listing(["b", "a"]) == "a, b"
    assert listing([]) == "none"
    assert listing((f"joint{i:03d}" for i in range(50)), most=2) == "joint000, joint001, ... (50 in all)"
