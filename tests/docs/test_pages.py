# SPDX-License-Identifier: BSD-3-Clause
"""What the pages point to exists: files, folders, headings, tests, modules."""

import ast
import importlib
import re
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest

_ROOT = Path(__file__).resolve().parents[2]
_ROOT_PAGES = ("README.md", "ARCHITECTURE.md", "CONVENTIONS.md", "CONTRIBUTING.md", "CHANGELOG.md")
_PAGES = tuple(sorted(_ROOT.glob("docs/**/*.md"))) + tuple(_ROOT / name for name in _ROOT_PAGES)
_OF_TODAY = tuple(page for page in _PAGES if page.name != "CHANGELOG.md")  # the changelog keeps the names of its time

_LINK = re.compile(r"\]\((?!https?:)([^)\s#]*)(?:#([^)\s]*))?\)")
_HEADING = re.compile(r"^#+ +(.+?) *$", flags=re.MULTILINE)
_TEST = re.compile(r"`(tests/[\w/]+\.py)::(test_\w+)`")
_CODE = re.compile(r"`([^`\n]+)`")
_FILE = re.compile(r"(?:(?:coclo_vio|tests|docs|examples)/[\w./-]*\w|[\w/]+\.py)")
_ENTRY_POINTS = "coclo_vio.plugins"  # the group of entry points, which is no module
_DOTTED = re.compile(r"(?<![\w./])coclo_vio(?:\.[A-Za-z_]\w*)+")

every_page = pytest.mark.parametrize("page", _PAGES, ids=lambda path: str(path.relative_to(_ROOT)))
every_page_of_today = pytest.mark.parametrize("page", _OF_TODAY, ids=lambda path: str(path.relative_to(_ROOT)))


@every_page
def test_every_link_leads_to_a_file_and_a_heading(page: Path) -> None:
    assert list(_broken_links(page)) == []


@every_page_of_today
def test_every_test_that_is_named_exists(page: Path) -> None:
    named = _TEST.findall(page.read_text(encoding="utf-8"))
    assert [f"{path}::{name}" for path, name in named if name not in _tests_of(_ROOT / path)] == []


@every_page_of_today
def test_every_file_that_is_named_exists(page: Path) -> None:
    assert [name for name in _files_named(page.read_text(encoding="utf-8")) if not _is_file_of_ours(name)] == []


@every_page_of_today
def test_every_dotted_path_that_is_named_exists(page: Path) -> None:
    named = set(_DOTTED.findall(page.read_text(encoding="utf-8")))
    assert sorted(path for path in named - {_ENTRY_POINTS} if not _resolves(path)) == []


def test_the_pages_name_tests_files_and_modules() -> None:
    text = "\n".join(page.read_text(encoding="utf-8") for page in _OF_TODAY)
    assert len(_TEST.findall(text)) > 50
    assert len(list(_files_named(text))) > 20
    assert len(_DOTTED.findall(text)) > 5


def test_what_does_not_exist_is_found(tmp_path: Path) -> None:
    (tmp_path / "there.md").write_text("# A heading: of *two*, parts\n```\n# no heading\n```\n", encoding="utf-8")
    links = "[a](there.md#a-heading-of-two-parts) [b](gone.md) [c](there.md#no-heading) [d](#here) [e](https://a.b/c)\n"
    (tmp_path / "page.md").write_text(links, encoding="utf-8")
    assert list(_broken_links(tmp_path / "page.md")) == ["gone.md", "there.md#no-heading", "#here"]
    assert "test_of_nobody" not in _tests_of(Path(__file__))
    assert "test_what_does_not_exist_is_found" in _tests_of(Path(__file__))
    named = list(_files_named("`coclo_vio/cli`, `filter/config.py`, `my_log.csv`, `coclo_vio/gone.py`, `gone.py`"))
    assert [name for name in named if not _is_file_of_ours(name)] == ["coclo_vio/gone.py", "gone.py"]
    dotted = ["coclo_vio.geometry", "coclo_vio.geometry.so3", "coclo_vio.geometry.so3.exp", "coclo_vio.geometry.so3.no"]
    assert [_resolves(path) for path in dotted] == [True, True, True, False]


def _broken_links(page: Path) -> Iterator[str]:
    for target, anchor in _LINK.findall(_without_blocks(page.read_text(encoding="utf-8"))):
        file = (page.parent / target).resolve() if target else page
        if not file.exists() or (anchor and anchor not in _anchors(file)):
            yield f"{target}#{anchor}" if anchor else target


@cache
def _anchors(page: Path) -> frozenset[str]:
    """Anchors of a page's headings, as mkdocs and GitHub both make them."""
    headings = _HEADING.findall(_without_blocks(page.read_text(encoding="utf-8")))
    return frozenset(re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings)


def _without_blocks(text: str) -> str:
    return re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)


@cache
def _tests_of(file: Path) -> frozenset[str]:
    if not file.is_file():
        return frozenset()
    tree = ast.parse(file.read_text(encoding="utf-8"))
    return frozenset(node.name for node in tree.body if isinstance(node, ast.FunctionDef))


def _files_named(text: str) -> Iterator[str]:
    for code in _CODE.findall(_without_blocks(text)):
        yield from (word for word in code.split() if _FILE.fullmatch(word))


def _is_file_of_ours(name: str) -> bool:
    """Whether a path exists from the root, or, of a Python file, as the end of a path in the package or the tests."""
    return (_ROOT / name).exists() or any(f"/{path}".endswith(f"/{name}") for path in _python_files())


@cache
def _python_files() -> tuple[str, ...]:
    return tuple(path.as_posix() for folder in ("coclo_vio", "tests") for path in (_ROOT / folder).rglob("*.py"))


def _resolves(dotted: str) -> bool:
    """Whether a dotted path is a module, or a name in one."""
    parent, _, name = dotted.rpartition(".")
    try:
        if find_spec(dotted) is not None:
            return True
    except ModuleNotFoundError:
        if not _resolves(parent):
            return False
    try:
        return hasattr(importlib.import_module(parent), name)
    except ModuleNotFoundError:  # a name of a class
        return False
