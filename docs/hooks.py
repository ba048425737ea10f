# SPDX-License-Identifier: BSD-3-Clause
"""What the site's build adds to mkdocs: the pages of the root, formulas as MathML, a check for links to other hosts."""

import html
import logging
import posixpath
import re
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

_LOG = logging.getLogger("mkdocs.hooks")  # a warning here fails a strict build
_ROOT_PAGES = {
    "ARCHITECTURE.md": "architecture.md",
    "CHANGELOG.md": "changelog.md",
    "CONTRIBUTING.md": "contributing.md",
    "CONVENTIONS.md": "conventions.md",
    "README.md": "index.md",
}
_LINK = re.compile(r"(\]\()([^)\s#:]+)((?:#[^)\s]*)?\))")
_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', flags=re.DOTALL)
_LOADED = re.compile(r"<(?:script|img|iframe|link)\b[^>]*?\b(?:src|href)=[\"']?(?:https?:)?//[^\"'\s>]+")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages of the repository's root, which the site shows as they are."""
    root = Path(config.docs_dir).parent
    for name, page in _ROOT_PAGES.items():
        if page != "index.md":
            files.append(File.generated(config, page, content=(root / name).read_text(encoding="utf-8")))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Point links between docs/ and the repository's root to the pages of the site."""
    is_root_page = page.file.src_uri in _ROOT_PAGES.values() and page.file.src_uri != "index.md"
    folder = "" if is_root_page else posixpath.join("docs", posixpath.dirname(page.file.src_uri))

    def moved(link: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(folder, link[2]))
        on_site = _ROOT_PAGES.get(target, target.removeprefix("docs/"))
        return link[1] + posixpath.relpath(on_site, posixpath.dirname(page.file.src_uri) or ".") + link[3]

    return _LINK.sub(moved, markdown)


def on_page_content(content: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Write formulas as MathML, which browsers draw without a script or a font from elsewhere."""

    def drawn(formula: re.Match[str]) -> str:
        latex = html.unescape(formula[3]).strip()
        display = "block" if formula[2] == "[" else "inline"
        return convert(latex, display=display).replace(r"\_", "_")

    return _FORMULA.sub(drawn, content)


def on_post_page(output: str, page: Page, config: MkDocsConfig) -> str:
    """Warn of whatever a page would load from another host: the site works without a network."""
    for loaded in _LOADED.findall(output):
        _LOG.warning("%s loads something from another host: %s", page.file.src_uri, loaded)
    return output
