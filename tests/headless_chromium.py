# SPDX-License-Identifier: BSD-3-Clause
"""A page drawn by headless Chromium in a window of any width: what it measured, and what the console said."""

import json
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

_FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync", "--enable-logging=stderr"),
    "--virtual-time-budget=30000",
)
# Chromium's own window is never narrower than 500 px, so the page stands in a frame that can be.
_FRAME = """<!DOCTYPE html><html><body style="margin:0"><iframe src="probed.html" style="border:0;width:{width}px;
height:{height}px"></iframe><script>addEventListener('message', (event) => {{
document.body.dataset.measured = JSON.stringify(event.data); }});</script></body></html>"""
_PROBE = """<script>setInterval(() => { const page = document.documentElement;
const lines = document.querySelectorAll('.zoomable path.js-line');
const buttons = [...document.querySelectorAll('.modebar-btn')].map((one) => one.dataset.title || '');
parent.postMessage({drawn: Number(document.body.dataset.drawn || 0), failed: document.body.dataset.failed || '',
lines: lines.length,
buttons: [...new Set(buttons)].join(', '), width: page.clientWidth, needed: page.scrollWidth, height: page.scrollHeight,
smallest: Math.min(...[...document.querySelectorAll('p, td, label, text')].filter((one) => one.textContent.trim())
.map((one) => parseFloat(getComputedStyle(one).fontSize)))}, '*'); }, 100);</script></body>"""


@dataclass(frozen=True)
class Drawn:
    """A page as a browser drew it.

    Attributes:
        measured: plots ``drawn``, why they ``failed``, ``lines`` in them and ``buttons``, the ``width`` of the page
            and the width ``needed``, px, and the ``smallest`` letters, px.
        console: lines that the page caused on the console.
    """

    measured: dict[str, float | str]
    console: list[str]


def chromium() -> str:
    """The browser; without it the test is skipped."""
    found = shutil.which("chromium") or shutil.which("chromium-browser")
    if found is None:
        pytest.skip("there is no chromium on this machine; apt-get install chromium brings it")
    return found


def drawn(page: Path, folder: Path, width: int, picture: Path | None = None, height: int = 900) -> Drawn:
    """Draw a page.

    Args:
        page: HTML file.
        folder: for the frame around it and the browser's files.
        width: of the window, px.
        picture: PNG file for what it looks like; none if None.
        height: of the window, px.
    """
    browser = chromium()
    probed = page.read_text(encoding="utf-8").replace("</body>", _PROBE)
    (folder / "probed.html").write_text(probed, encoding="utf-8")
    frame = folder / "frame.html"
    frame.write_text(_FRAME.format(width=width, height=height), encoding="utf-8")
    flags = [*_FLAGS, f"--user-data-dir={folder / 'browser'}", f"--window-size={max(width, 500)},{height}"]
    done = subprocess.run(
        [browser, *flags, "--dump-dom", frame.as_uri()], capture_output=True, text=True, check=True, timeout=240
    )
    if picture is not None:
        command = [browser, *flags, f"--screenshot={picture}", frame.as_uri()]
        subprocess.run(command, capture_output=True, check=True, timeout=240)
    _, found, rest = done.stdout.partition("data-measured='")
    if not found:
        _, found, rest = done.stdout.partition('data-measured="')
    assert found, done.stdout[:500] + done.stderr[-2000:]
    text = rest.partition('">' if rest.startswith("{&quot;") else "'>")[0].replace("&quot;", '"')
    return Drawn(json.loads(text), [line for line in done.stderr.splitlines() if ":CONSOLE" in line])
