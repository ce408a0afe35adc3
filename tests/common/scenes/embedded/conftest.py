import pytest

from readygo.common.gaussians import GaussianCloud
from readygo.common.scenes import Scene
from readygo.common.scenes.embedded import bundle, ensure_embedded_scene
from readygo.common.scenes.embedded.scene import embedded_scene_cloud


@pytest.fixture(scope="session")
def cloud() -> GaussianCloud:
    return embedded_scene_cloud()


@pytest.fixture(scope="session")
def made(cloud: GaussianCloud, tmp_path_factory: pytest.TempPathFactory) -> Scene:
    patch = pytest.MonkeyPatch()
    patch.setattr(bundle, "embedded_scene_cloud", lambda seed: cloud)
    scene = ensure_embedded_scene(tmp_path_factory.mktemp("scenes") / "embedded")
    patch.undo()
    return scene
