import pytest

from readygo.common.scenes import Scene
from tests.apps.report.scenes import reconstructed


@pytest.fixture(scope="session")
def filmed_room(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    return reconstructed(tmp_path_factory.mktemp("health") / "<room>")
