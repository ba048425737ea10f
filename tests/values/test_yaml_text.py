# SPDX-License-Identifier: BSD-3-Clause
"""YAML as people have it: what is read of it, and what is refused in one sentence and at once."""

import time
from pathlib import Path

import pytest

from coclo_vio.values.config import parse_settings, read_yaml
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.yaml_text import MOST_CHARACTERS, parse_yaml

DOUBLING = "\n".join(["x0: &x0 [1, 2]", *(f"x{i}: &x{i} [*x{i - 1}, *x{i - 1}]" for i in range(1, 31))])


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("", None),
        ("a: 2020-01-01", {"a": "2020-01-01"}),
        ("2020-01-01: 1", {"2020-01-01": 1}),
        ("{1: a, 2.5: b, on: c, null: d}", {"1": "a", "2.5": "b", "on": "c", "null": "d"}),
        ("%YAML:1.0\n---\na: 1", {"a": 1}),
        ("%YAML:1.0\nT: !!opencv-matrix\n  rows: 1\n  data: [1.0]", {"T": {"rows": 1, "data": [1.0]}}),
        ("a: &x {b: 1}\nc: {<<: *x, d: 2}", {"a": {"b": 1}, "c": {"b": 1, "d": 2}}),
        ("a: &x [1]\nb: *x", {"a": [1], "b": [1]}),
    ],
)
def test_keys_and_dates_are_text_and_the_lines_of_opencv_are_accepted(text, value):
    assert parse_yaml(text) == value


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        (DOUBLING, "expands to more than 20000 elements"),
        ("a: &a [*a]", "holds an alias of what it is in"),
        ("[" * 100 + "]" * 100, "nested more than 40 levels deep"),
        ("[" * 5000 + "]" * 5000, "nested more than 40 levels deep"),
        ("? [1, 2]\n: 3", "a key that is a list or a mapping"),
        ("a: " + "1" * 5000, "a value that cannot be read"),
        ("a: [1", "is not YAML, line 1"),
        ("a: !!python/object/apply:os.getcwd []", "is not YAML, line 1"),
        ("a: !!int x", "a value that cannot be read"),
        ("a: \x01", "is not YAML"),
        ("a: *missing", "undefined alias"),
        ('a: "\\ud800"', "a character that is none"),
        ("a" * (MOST_CHARACTERS + 1), "more than the 200000 that are read"),
    ],
)
def test_what_is_no_plain_data_is_refused_at_once(tmp_path: Path, text: str, sentence: str) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(text, encoding="utf-8")
    start_s = time.monotonic()
    with pytest.raises(ConfigError, match=sentence) as error:
        read_yaml(path)
    assert time.monotonic() - start_s < 2.0
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 600


@pytest.mark.parametrize("name", ["a" * 5000 + ".yaml", "a\0b.yaml"])
def test_a_path_that_no_file_can_have_is_one_sentence(name: str) -> None:
    with pytest.raises(ConfigError, match="cannot read the configuration") as error:
        read_yaml(Path(name))
    assert len(str(error.value)) < 600


def test_settings_have_the_same_bounds() -> None:
    assert parse_settings(["a.b=2020-01-01"]) == {"a": {"b": "2020-01-01"}}
    with pytest.raises(ConfigError, match=r"takes key\.subkey=value, got 1001 keys"):
        parse_settings([".".join(["a"] * 1001) + "=1"])
    with pytest.raises(ConfigError, match="holds an alias"):
        parse_settings(["a=&a [*a]"])
