# SPDX-License-Identifier: BSD-3-Clause
"""The listing of commands, and what ``--version`` and ``--help`` load: no stage and no numerical library."""

import inspect
import json
import os
import subprocess
import sys
from importlib import import_module

import pytest
from console import Coclo, is_one_sentence

from coclo_vio import __version__
from coclo_vio.cli.application import COMMANDS

HEAVY = {"numpy", "scipy", "gtsam", "cv2", "pinocchio", "pydantic", "yaml", "matplotlib", "rosbags", "mujoco"}
STAGES = {f"coclo_vio.{room}" for room in ("api", "runs", "fusion", "filter", "frontend", "backend", "datasets")}
# Runs the package as `python -m` does and prints what is loaded at the end.
PROBE = """
import json, runpy, sys
sys.argv = ["coclo-vio", *sys.argv[1:]]
try:
    runpy.run_module("coclo_vio", run_name="__main__")
finally:
    print(json.dumps(sorted(sys.modules)), file=sys.stderr)
"""


def loaded_by(*arguments: str) -> set[str]:
    """The modules in memory when the command ends."""
    command = [sys.executable, "-c", PROBE, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return set(json.loads(done.stderr))


@pytest.mark.parametrize("name", COMMANDS)
def test_the_summary_of_a_command_is_the_first_line_of_its_help(name: str) -> None:
    function = getattr(import_module(f"coclo_vio.cli.{COMMANDS[name].module}"), name)
    assert (inspect.getdoc(function) or "").partition("\n")[0] == COMMANDS[name].summary


def test_the_package_runs_as_a_module() -> None:
    done = subprocess.run([sys.executable, "-m", "coclo_vio", "--version"], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == (f"{__version__}\n", "")


@pytest.mark.parametrize("option", ["--version", "--help"])
def test_version_and_help_load_no_stage_and_no_numerical_library(option: str) -> None:
    loaded = loaded_by(option)
    assert "coclo_vio.cli.application" in loaded
    assert sorted(loaded & (HEAVY | STAGES)) == []


@pytest.mark.long
def test_a_command_loads_what_it_needs_and_nothing_else() -> None:
    loaded = loaded_by("config")
    assert {"numpy", "pydantic"} <= loaded, "the probe finds what is loaded"
    assert sorted(loaded & {"gtsam", "matplotlib", "mujoco"}) == []


def test_the_listing_has_every_command_with_its_summary() -> None:
    command = [sys.executable, "-m", "coclo_vio", "--help"]
    shown = subprocess.run(command, capture_output=True, text=True, check=True, env={"COLUMNS": "300"}).stdout
    rows = {line.split()[1]: line for line in shown.splitlines() if len(line.split()) > 2}
    for name, entry in COMMANDS.items():
        assert entry.summary in rows[name]


def test_one_thread_computes_unless_the_environment_says_otherwise() -> None:
    """More threads of BLAS than one double the processor time of ``combined``."""
    script = (
        "import os, sys; sys.argv = ['coclo-vio', '--version']\n"
        "from coclo_vio.cli import main\n"
        "try:\n    main()\nexcept SystemExit:\n    pass\n"
        "assert 'numpy' not in sys.modules\n"
        "print(os.environ['OPENBLAS_NUM_THREADS'], os.environ['OMP_NUM_THREADS'])"
    )
    plain = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    for given, expected in (({}, "1 1"), ({"OMP_NUM_THREADS": "2"}, "1 2")):
        done = subprocess.run(
            [sys.executable, "-c", script], env={**plain, **given}, capture_output=True, text=True, check=True
        )
        assert done.stdout.splitlines()[-1] == expected


@pytest.mark.parametrize("command", ["inspect", "run", "evaluate"])
def test_a_path_that_no_file_can_have_is_one_sentence(coclo: Coclo, command: str) -> None:
    answer = coclo(command, "x" * 300)
    assert answer.status == 1
    assert is_one_sentence(answer)
