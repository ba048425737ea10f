# SPDX-License-Identifier: BSD-3-Clause
"""The API reference has every public name, and the pages on extending show the examples that are tested."""

import re
from pathlib import Path

import pytest

import coclo_vio as cv

_DOCS = Path(__file__).resolve().parents[2] / "docs"
_DIRECTIVE = re.compile(r"^::: coclo_vio\.([\w.]+)$", flags=re.MULTILINE)
_EXAMPLES = {
    "contact.md": "contact_estimator_plugin.py",
    "feedback.md": "feedback_policy_plugin.py",
    "format.md": "format_plugin.py",
    "mode.md": "mode_plugin.py",
}


def _described() -> set[str]:
    pages = (page.read_text(encoding="utf-8") for page in (_DOCS / "api").glob("*.md"))
    return {path for page in pages for path in _DIRECTIVE.findall(page)}


@pytest.mark.parametrize("name", [name for name in cv.__all__ if name != "__version__"])
def test_every_public_name_is_in_the_reference(name: str) -> None:
    module, attribute = cv._RENAMED.get(name) or (cv._MODULES[name], name)
    assert {module, f"{module}.{attribute}"} & _described(), f"no `::: coclo_vio.{module}.{attribute}` in docs/api"


def test_every_example_of_an_extension_is_on_a_page() -> None:
    assert set(_EXAMPLES.values()) == {path.name for path in (_DOCS / "extending" / "examples").glob("*.py")}


@pytest.mark.parametrize("page", _EXAMPLES)
def test_a_page_on_extending_shows_the_example_that_is_tested(page: str) -> None:
    """Where this fails: copy the file, without its licence line, into the block of the page."""
    example = (_DOCS / "extending" / "examples" / _EXAMPLES[page]).read_text(encoding="utf-8")
    text = (_DOCS / "extending" / page).read_text(encoding="utf-8")
    (block,) = re.findall(r"^```python\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)
    assert block == example.partition("\n")[2]
    assert f"docs/extending/examples/{_EXAMPLES[page]}" in text
