# SPDX-License-Identifier: BSD-3-Clause
import os
from pathlib import Path

import pytest

_SHARED_DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of recordings beside the repository; a test that needs it may skip, but never in CI."""
    if _SHARED_DATA.is_dir():
        return _SHARED_DATA
    reason = "the recordings in ../shared/data (beside the repository) are not on this machine"
    if os.environ.get("CI") == "true":
        pytest.fail(f"CI=true, but {reason}")
    pytest.skip(reason)
