# SPDX-License-Identifier: BSD-3-Clause
import os
from collections.abc import Generator
from pathlib import Path

import pytest
from hypothesis import settings
from short_recording import write_beginning, write_leg_walk

# The same examples on every machine and in every run.
settings.register_profile("repeatable", derandomize=True, deadline=None, database=None)
settings.load_profile("repeatable")

_SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
_IS_CI = os.environ.get("CI") == "true"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of recordings beside the repository; a test that needs it may skip, but never in CI."""
    if _SHARED_DATA.is_dir():
        return _SHARED_DATA
    pytest.skip("the recordings in ../shared/data (beside the repository) are not on this machine")


@pytest.fixture(scope="session")
def short_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``walk.mcap``: the first six seconds of the bundled recording, with all sensors and ground truth."""
    return write_beginning(tmp_path_factory.mktemp("short_recording") / "walk.mcap")


@pytest.fixture(scope="session")
def leg_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``walk``: a leg log of a Daisy over three seconds, with ground truth."""
    return write_leg_walk(tmp_path_factory.mktemp("leg_log") / "walk")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """With CI=true a skipped test is a failed one: what was not run was not tested."""
    report = yield
    if _IS_CI and report.skipped and not hasattr(report, "wasxfail"):
        report.outcome = "failed"
        report.longrepr = f"CI=true, and {item.nodeid} was skipped: {report.longrepr}"
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """The same for a whole module that skips itself."""
    report = yield
    if _IS_CI and report.skipped:
        report.outcome = "failed"
        report.longrepr = f"CI=true, and {collector.nodeid} was skipped: {report.longrepr}"
    return report
