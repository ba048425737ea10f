# SPDX-License-Identifier: BSD-3-Clause
from pathlib import Path
from typing import Annotated

import pytest
from pydantic import Field, ValidationError, model_validator

from coclo_vio.values.config import StageConfig, merged, parse_settings, read_yaml, write_yaml
from coclo_vio.values.errors import ConfigError


class _Leg(StageConfig):
    radius_m: Annotated[float, Field(gt=0)] = 0.02


class _Gait(StageConfig):
    """A section with a constraint between two fields."""

    low: float = 1.0
    high: float = 2.0

    @model_validator(mode="after")
    def _in_order(self) -> "_Gait":
        if self.low >= self.high:
            raise ValueError(f"low = {self.low} must lie below high = {self.high}")
        return self


class _Robot(StageConfig):
    name: str = "robot"
    rate_hz: Annotated[float, Field(gt=0, le=1000)] = 100.0
    legs: tuple[_Leg, ...] = (_Leg(),)
    spare: _Leg | None = None
    gait: _Gait = _Gait()


def _problem(values: dict[str, object]) -> str:
    with pytest.raises(ConfigError) as caught:
        _Robot.parse(values, "my.yaml")
    return str(caught.value)


def test_everything_has_a_usable_default_and_cannot_be_changed() -> None:
    config = _Robot.parse({}, "nothing")
    assert config == _Robot()
    with pytest.raises(ValidationError, match="frozen"):
        config.rate_hz = 5.0


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"rat_hz": 5}, "my.yaml: there is no rat_hz; the keys there are: gait, legs, name, rate_hz, spare"),
        ({"gait": {"lo": 1}}, "my.yaml: there is no gait.lo; the keys there are: high, low"),
        ({"legs": [{}, {"radius": 1}]}, "my.yaml: there is no legs.1.radius; the keys there are: radius_m"),
        ({"spare": {"radius": 1}}, "my.yaml: there is no spare.radius; the keys there are: radius_m"),
    ],
)
def test_an_unknown_key_is_refused_with_the_known_ones(values: dict[str, object], message: str) -> None:
    assert _problem(values) == message


def test_a_value_out_of_bounds_is_named_with_its_limit() -> None:
    assert _problem({"rate_hz": 0}) == "my.yaml: rate_hz = 0: Input should be greater than 0"
    assert _problem({"rate_hz": float("nan")}).startswith("my.yaml: rate_hz = nan: Input should be a finite number")
    assert _problem({"legs": [{"radius_m": -1}]}).startswith("my.yaml: legs.0.radius_m = -1: Input should be greater")


def test_a_violated_constraint_is_reported_without_the_whole_configuration() -> None:
    assert _problem({"gait": {"low": 3.0}}) == "my.yaml: gait: low = 3.0 must lie below high = 2.0"


def test_a_file_written_with_every_default_is_read_back_equal(tmp_path: Path) -> None:
    config = _Robot(name="mine", legs=(_Leg(radius_m=0.03), _Leg()), spare=_Leg())
    write_yaml(config, tmp_path / "config.yaml")
    values = read_yaml(tmp_path / "config.yaml")
    assert values["rate_hz"] == 100.0
    assert _Robot.parse(values, "config.yaml") == config


def test_yaml_that_is_missing_empty_or_no_mapping(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    with pytest.raises(ConfigError, match=r"cannot read the configuration .*a\.yaml: No such file"):
        read_yaml(path)
    path.write_text("# nothing yet\n", encoding="utf-8")
    assert read_yaml(path) == {}
    path.write_text("- 1\n- 2\n", encoding="utf-8")
    with pytest.raises(ConfigError, match="must hold a mapping of keys to values, it holds a list"):
        read_yaml(path)
    path.write_text("a: [1\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"a\.yaml is not YAML"):
        read_yaml(path)


def test_settings_make_a_nested_mapping_of_yaml_values() -> None:
    settings = ["gait.low=0.5", "gait.high=1e-3", "name=daisy", "spare=null", "legs=[{radius_m: 0.1}]"]
    assert parse_settings(settings) == {
        "gait": {"low": 0.5, "high": "1e-3"},
        "name": "daisy",
        "spare": None,
        "legs": [{"radius_m": 0.1}],
    }


def test_a_number_that_yaml_reads_as_text_is_still_a_number() -> None:
    """YAML 1.1 requires a dot as in 1.0e-3; users omit it."""
    assert _Robot.parse(parse_settings(["rate_hz=1e2"]), "--set").rate_hz == 100.0


def test_the_last_of_two_settings_of_one_key_wins() -> None:
    assert parse_settings(["a.b=1", "a.c=2", "a.b=3"]) == {"a": {"b": 3, "c": 2}}


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("rate_hz", "key.subkey=value, got 'rate_hz'"),
        ("=5", "got '=5'"),
        ("a.b=[1", r"--set a\.b: '\[1' is not YAML"),
    ],
)
def test_a_setting_that_cannot_be_read_is_named(setting: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        parse_settings([setting])


def test_merged_updates_nested_keys_and_leaves_its_arguments_unchanged() -> None:
    base = {"a": {"b": 1, "c": 2}, "d": [1, 2]}
    changes = {"a": {"b": 5}, "d": [3], "e": {"f": 1}}
    assert merged(base, changes) == {"a": {"b": 5, "c": 2}, "d": [3], "e": {"f": 1}}
    assert base == {"a": {"b": 1, "c": 2}, "d": [1, 2]}
    assert merged({"a": 1}, {"a": {"b": 2}}) == {"a": {"b": 2}}
