"""Fixtures shared by all tests."""

from pathlib import Path

import pytest

from apps.compiled import use_own_kernels

use_own_kernels()

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Folder of the real scenes, maps, mocap and avatars; tests that need it skip where it is absent."""
    if not SHARED.is_dir():
        pytest.skip("the real scenes and avatars (../shared/data) are not on this machine")
    return SHARED
