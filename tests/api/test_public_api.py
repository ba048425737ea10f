# SPDX-License-Identifier: BSD-3-Clause
"""What ``import coclo_vio`` offers: its names, which load nothing until they are used, and the contract's block."""

import ast
import importlib
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import coclo_vio as cv

ROOT = Path(__file__).resolve().parents[2]
# The contract of the public API, as the quick start shows it.
CONTRACT = """
import coclo_vio as cv

recording = cv.open("walk.mcap", robot="go1")
run = cv.run(recording, mode="combined")
run.metrics()
run.save("out"); run.plot("path")
cv.compare([recording], modes=["coclo", "vins", "combined"])
cv.evaluate("estimate.tum", "vicon.tum")

odometry = cv.make_estimator("combined", robot=robot, calibration=calibration)
for output in odometry.push(measurement): ...
for output in odometry.finish(): ...
"""
# Prints the top-level names of what an import adds to the modules in memory.
PROBE = """
import sys
before = set(sys.modules)
import coclo_vio as cv
{use}
added = {{name.partition(".")[0] for name in set(sys.modules) - before}}
import json
print(json.dumps(sorted(added - set(sys.stdlib_module_names))))
"""


def added_by_import(use: str = "") -> list[str]:
    """Packages outside the standard library that the import, and a use of it, load."""
    done = subprocess.run([sys.executable, "-c", PROBE.format(use=use)], capture_output=True, text=True, check=True)
    return [str(name) for name in json.loads(done.stdout)]


@pytest.mark.long
def test_the_block_of_the_contract_runs_as_written(
    go1_walk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    shutil.copy(go1_walk, "walk.mcap")
    recording = cv.open("walk.mcap", robot="go1")
    truth = recording.ground_truth()
    assert truth is not None
    for name in ("vicon.tum", "estimate.tum"):
        cv.write_tum(truth.trajectory, Path(name))
    variables = {
        "robot": "go1",
        "calibration": recording.calibration,
        "measurement": next(recording.measurements()),
    }
    exec(CONTRACT, variables)
    run = variables["run"]
    assert isinstance(run, cv.Run)
    assert run.names == ("combined_coclo", "combined_vins")
    assert {path.name for path in Path("out").iterdir()} >= {
        *("combined_coclo.tum", "combined_coclo_state.csv", "groundtruth.tum", "config.yaml", "run.json")
    }
    assert run.calibration is not None, "the combined filter learns the mounting of the cameras"


def test_the_quick_start_shows_the_contract() -> None:
    page = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```", page, flags=re.DOTALL | re.MULTILINE)
    assert [ast.dump(ast.parse(block)) for block in blocks] == [ast.dump(ast.parse(CONTRACT))]


@pytest.mark.long
def test_the_python_of_the_readme_runs(go1_walk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    shutil.copy(go1_walk, "my_log.mcap")
    (block,) = re.findall(r"^```python\n(.*?)^```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL | re.MULTILINE)
    exec(block, {"print": lambda *_: None})
    assert Path("path.png").read_bytes().startswith(b"\x89PNG")


def test_the_import_loads_no_third_party_package() -> None:
    assert added_by_import() == ["coclo_vio"]
    assert "numpy" in added_by_import("cv.Trajectory"), "the probe finds what a name loads"


@pytest.mark.parametrize("use", ["cv.CocloError", "cv.__version__", "dir(cv)", "from coclo_vio import ConfigError"])
def test_names_that_need_no_package_load_none(use: str) -> None:
    assert added_by_import(use) == ["coclo_vio"]


@pytest.mark.parametrize("name", cv.__all__)
def test_every_public_name_exists_and_is_listed(name: str) -> None:
    assert getattr(cv, name) is not None
    assert name in dir(cv)


def test_star_import_gives_every_public_name() -> None:
    names: dict[str, object] = {}
    exec("from coclo_vio import *", names)
    assert set(cv.__all__) <= set(names)


def test_a_name_that_does_not_exist_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="module 'coclo_vio' has no attribute 'opn'"):
        cv.opn  # noqa: B018


def test_the_names_for_type_checkers_are_those_of_the_table() -> None:
    tree = ast.parse((ROOT / "coclo_vio" / "__init__.py").read_text(encoding="utf-8"))
    (guarded,) = [node for node in tree.body if isinstance(node, ast.If)]
    declared = {
        alias.asname: (str(node.module).removeprefix("coclo_vio."), alias.name)
        for node in guarded.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    homes = {name: (module, name) for module, names in cv._HOMES.items() for name in names}
    assert declared == homes | cv._RENAMED


def test_every_name_is_defined_where_the_table_says() -> None:
    """Not imported there from another module: documentation and tracebacks then name the same place."""
    for module, names in cv._HOMES.items():
        home = importlib.import_module(f"coclo_vio.{module}")
        for name in names:
            defined_in = getattr(getattr(home, name), "__module__", home.__name__)
            assert defined_in in {home.__name__, "types", "typing"}, name
