# SPDX-License-Identifier: BSD-3-Clause
import json
from pathlib import Path
from typing import Literal

import pytest
from pydantic import ValidationError

from coclo_vio.values.errors import DatasetError
from coclo_vio.values.record import Record


class Wheel(Record):
    schema_version: Literal[3] = 3
    radius_m: float


class Cart(Record):
    next_step = "build the cart again"

    schema_version: Literal[1] = 1
    name: str
    wheels: tuple[Wheel, ...] = ()


CART = Cart(name="hay", wheels=(Wheel(radius_m=0.4), Wheel(radius_m=0.5)))


def test_a_record_is_read_as_it_was_written(tmp_path: Path) -> None:
    CART.write(tmp_path / "cart.json")
    assert Cart.read(tmp_path / "cart.json") == CART
    assert json.loads((tmp_path / "cart.json").read_text()) == {
        "schema_version": 1,
        "name": "hay",
        "wheels": [{"schema_version": 3, "radius_m": 0.4}, {"schema_version": 3, "radius_m": 0.5}],
    }


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema_version": 7}, r"^cart: it has schema version 7, this release reads version 1; build the cart again$"),
        ({"schema_version": None}, r"^cart: it has no schema version, this release reads version 1; build the cart"),
        (
            {"wheels": [{"schema_version": 2, "radius_m": 0.4}]},
            r"^cart: wheels.0: it has schema version 2, this release reads version 3; build",
        ),
        ({"colour": "red"}, r"there is no colour; the keys there are: name, schema_version, wheels; build"),
        ({"name": 3}, r"name = 3: Input should be a valid string; build"),
        ({"wheels": [{"schema_version": 3, "radius_m": float("nan")}]}, r"wheels.0.radius_m = nan: .*finite"),
    ],
)
def test_what_is_no_such_record_is_refused_with_the_next_step(change: dict[str, object], message: str) -> None:
    with pytest.raises(DatasetError, match=message):
        Cart.parse(CART.to_json() | change, "cart")


def test_a_record_without_version_is_refused(tmp_path: Path) -> None:
    (tmp_path / "cart.json").write_text('{"name": "hay"}')
    with pytest.raises(DatasetError, match="no schema version"):
        Cart.read(tmp_path / "cart.json")


@pytest.mark.parametrize(("text", "message"), [("{", "is not JSON"), ("[]", "Input should be")])
def test_a_file_that_holds_no_record_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "cart.json").write_text(text)
    with pytest.raises(DatasetError, match=message):
        Cart.read(tmp_path / "cart.json")


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"cannot read .*cart.json: No such file.*; build the cart again"):
        Cart.read(tmp_path / "cart.json")


def test_a_record_is_frozen_and_takes_no_unknown_key() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        CART.name = "coal"  # type: ignore[misc]
    with pytest.raises(ValidationError, match="Extra inputs"):
        Wheel(radius_m=0.4, spokes=12)  # type: ignore[call-arg]
