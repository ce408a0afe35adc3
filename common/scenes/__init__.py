"""Scene bundles: a folder with a Gaussian scene, its maps and its metadata."""

from readygo.common.scenes.bundle import SceneSource, import_scene, save_scene
from readygo.common.scenes.scene import Scene, SceneMaps, load_scene, verify_scene

__all__ = [
    "Scene",
    "SceneMaps",
    "SceneSource",
    "import_scene",
    "load_scene",
    "save_scene",
    "verify_scene",
]
