# SPDX-License-Identifier: BSD-3-Clause
"""What ARCHITECTURE.md and the house style promise about the sources, held."""

import ast
import logging.config
import re
import tomllib
from collections import Counter
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from importlinter.cli import EXIT_STATUS_SUCCESS, lint_imports

_ROOT = Path(__file__).resolve().parents[1]
_PACKAGE = _ROOT / "coclo_vio"
_SOURCES = sorted(_PACKAGE.rglob("*.py"))
_OURS = sorted([*_SOURCES, *(_ROOT / "tests").rglob("*.py")])
_MOST_LINES = 400
_MOST_FUNCTION_LINES = 50
_MOST_PARAMETERS = 8
_PRINTERS = ("cli/", "experiments/", "live/publish_recording.py")

# Metaphors, each of which has a standard term: vision, event log, localisation, marginal, novel information.
_REPLACED_WORDS = re.compile(
    r"(?i)(?<![a-z.])(?:eyes?|told|glances?|diary|habit|felt|laboratory|beliefs?|believed?|news|too sure)(?![a-z])"
)

# Who may import what; everybody else goes through them.
_IMPORTERS = {
    "gtsam": ("backend/",),
    "pinocchio": ("geometry/se3.py", "robot/pinocchio_legs.py"),
    "matplotlib": ("evaluation/figure_style.py", "experiments/studies/"),
    "plotly": ("evaluation/plotly_page.py",),
    "foxglove": ("views/foxglove_canvas.py",),
    "rerun": ("views/rerun_canvas.py",),
    "rosbags": ("datasets/rosbag/storage/", "datasets/rosbag/writing/new_bag.py"),
    "cv2": ("datasets/images.py", "frontend/", "simulation/visuals/", "views/"),
    "typer": ("cli/",),
    "rich": ("cli/",),
    "filterpy": ("experiments/filterpy_rival.py",),
    "distributed": ("experiments/table/cluster.py",),
    "mujoco": ("simulation/",),
    "zenoh": ("live/zenoh_wire.py",),
    "cyclonedds": ("live/dds_wire.py", "live/dds_types.py"),
}


def _name(path: Path) -> str:
    return str(path.relative_to(_ROOT))


def _inside(path: Path) -> str:
    return path.relative_to(_PACKAGE).as_posix()


def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _imported(tree: ast.Module) -> Iterator[str]:
    """Top-level names of all imports that are carried out, those inside functions too."""
    for_types = {id(inner) for node in ast.walk(tree) if _is_for_types(node) for inner in ast.walk(node)}
    for node in ast.walk(tree):
        if id(node) in for_types:
            continue
        match node:
            case ast.Import():
                yield from (alias.name.partition(".")[0] for alias in node.names)
            case ast.ImportFrom(module=str(module), level=0):
                yield module.partition(".")[0]


@cache
def _imported_by(path: Path) -> frozenset[str]:
    return frozenset(_imported(_tree(path)))


def _is_for_types(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"


def _exits_or_prints(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Name(id="print" | "exit" | "quit" | "input" as name)):
                yield name
            case ast.Attribute(value=ast.Name(id="sys"), attr="exit" | "stdout" | "stderr" as name):
                yield f"sys.{name}"
            case ast.ImportFrom(module="sys", names=[*names]) if {alias.name for alias in names} & {"exit", "stdout"}:
                yield "from sys import"
            case ast.Name(id="SystemExit"):
                yield "SystemExit"


def _public_without_docstring(parent: ast.Module | ast.ClassDef) -> Iterator[str]:
    """Public classes, functions and methods; what stands inside a function or a private class is nobody's interface."""
    for node in parent.body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef) and not node.name.startswith("_"):
            if not ast.get_docstring(node):
                yield node.name
            if isinstance(node, ast.ClassDef):
                yield from _public_without_docstring(node)


def test_the_import_contract_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(_ROOT)
    monkeypatch.setattr(logging.config, "dictConfig", lambda _: None)  # it would silence every logger of the process
    assert lint_imports(config_filename=str(_ROOT / "pyproject.toml"), no_cache=True) == EXIT_STATUS_SUCCESS


def test_the_import_contract_places_every_module() -> None:
    contracts = tomllib.loads((_ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"][
        "contracts"
    ]
    layers = next(contract for contract in contracts if contract["type"] == "layers")["layers"]
    placed = [module.strip() for layer in layers for module in layer.split("|")]
    there = {path.stem if path.is_file() else path.name for path in _PACKAGE.iterdir() if _is_module(path)}
    assert sorted(placed) == sorted(there)


def _is_module(path: Path) -> bool:
    return (path.suffix == ".py" and path.stem != "__init__") or (path / "__init__.py").is_file()


@pytest.mark.long
@pytest.mark.parametrize("library", _IMPORTERS)
def test_a_library_with_quirks_is_imported_in_one_place(library: str) -> None:
    importers = {str(path.relative_to(_PACKAGE)) for path in _SOURCES if library in _imported_by(path)}
    assert importers, f"nothing imports {library} any more: take it out of this list"
    assert {importer for importer in importers if not importer.startswith(_IMPORTERS[library])} == set()


def test_only_the_command_line_prints_or_exits() -> None:
    found = {
        _name(path): sorted(set(_exits_or_prints(_tree(path))))
        for path in _SOURCES
        if not _inside(path).startswith(_PRINTERS) and any(_exits_or_prints(_tree(path)))
    }
    assert found == {}


def test_the_search_for_printing_finds_it() -> None:
    source = "import sys\nfrom sys import exit\nprint(1)\nsys.exit(2)\nraise SystemExit"
    assert set(_exits_or_prints(ast.parse(source))) == {"print", "sys.exit", "from sys import", "SystemExit"}


@pytest.mark.long
def test_every_public_name_has_a_docstring() -> None:
    missing = [f"{_name(path)}: {name}" for path in _SOURCES for name in _public_without_docstring(_tree(path))]
    missing += [_name(path) for path in _SOURCES if not ast.get_docstring(_tree(path))]
    assert missing == []


def test_every_source_begins_with_its_licence() -> None:
    first = "# SPDX-License-Identifier: BSD-3-Clause\n"
    assert [_name(path) for path in _OURS if not path.read_text(encoding="utf-8").startswith(first)] == []


def test_no_module_outgrows_its_reader() -> None:
    lengths = {_name(path): len(path.read_text(encoding="utf-8").splitlines()) for path in _SOURCES}
    assert {name: length for name, length in lengths.items() if length > _MOST_LINES} == {}


def test_no_function_outgrows_its_reader() -> None:
    lengths = {f"{_name(path)}: {node.name}": _length(node) for path in _SOURCES for node in _functions(_tree(path))}
    assert {name: length for name, length in lengths.items() if length > _MOST_FUNCTION_LINES} == {}


def test_no_signature_outgrows_its_caller() -> None:
    counts = {
        f"{_name(path)}: {node.name}": _parameters(node)
        for path in _SOURCES
        if not _inside(path).startswith("cli/")
        for node in _functions(_tree(path))
    }
    assert {name: count for name, count in counts.items() if count > _MOST_PARAMETERS} == {}


def _functions(tree: ast.Module) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    yield from (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef))


def _length(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Lines of the body: a signature with a line a parameter is easy to read."""
    return (node.end_lineno or 0) - node.body[0].lineno + 1


def _parameters(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    names = [each.arg for each in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
    return len([name for name in names if name not in ("self", "cls")])


def test_no_two_modules_share_a_name() -> None:
    names = Counter(path.stem for path in _SOURCES)
    shared = {name for name, count in names.items() if count > 1} - {"__init__", "__main__", "config"}
    assert {name: sorted(_inside(path) for path in _SOURCES if path.stem == name) for name in shared} == {}


def test_no_two_test_modules_share_a_name() -> None:
    names = Counter(path.stem for path in (_ROOT / "tests").rglob("test_*.py"))
    assert [name for name, count in names.items() if count > 1] == []


@pytest.mark.parametrize("path", [path for path in _OURS if path.name != "test_architecture.py"], ids=_name)
def test_names_and_texts_use_the_words_of_the_field(path: Path) -> None:
    found = _REPLACED_WORDS.findall(path.read_text(encoding="utf-8"))
    assert found == [], "words that the glossary of the field replaces"


def test_no_module_is_a_drawer() -> None:
    assert {path.stem for path in _SOURCES} & {"utils", "common", "helpers", "misc"} == set()


def test_constraints_are_plain_versions() -> None:
    lines = (_ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    plain = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*==[0-9][0-9A-Za-z.+!]*")
    assert [line for line in lines if not plain.fullmatch(line)] == []
    assert len({_canonical(line.partition("==")[0]) for line in lines}) == len(lines)


def test_every_dependency_is_held_to_a_version() -> None:
    project = tomllib.loads((_ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [
        *project["dependencies"],
        *(name for extra in project["optional-dependencies"].values() for name in extra),
    ]
    names = {_canonical(re.split(r"[\[<>=~! ]", requirement)[0]) for requirement in wanted} - {"coclo-vio"}
    lines = (_ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    assert names - {_canonical(line.partition("==")[0]) for line in lines} == set()


def _canonical(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
