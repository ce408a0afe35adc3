import pytest


@pytest.fixture(scope="session")
def mocap(shared_data):
    """Folder of CMU clips."""
    return shared_data / "motion" / "cmu"
