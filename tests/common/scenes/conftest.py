import pytest

from readygo.common.scenes import save_scene
from tests.common.maps.room import sheet
from tests.common.scenes.small_room import small_room


@pytest.fixture(scope="session")
def scene(tmp_path_factory):
    sky = sheet((-50, -50, -5), (100, 0, 0), (0, 100, 0), spacing_m=10)
    return save_scene(small_room(), sky, tmp_path_factory.mktemp("scenes") / "small", license="CC0")


@pytest.fixture
def copy(scene, tmp_path):
    for file in scene.files:
        target = tmp_path / "copy" / file.path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes((scene.path / file.path).read_bytes())
    return tmp_path / "copy"
