"""The SCENE argument of commands: a bundle's folder, or the embedded scene."""

from pathlib import Path

from apps.paths import cache_folder
from common.scenes import Scene, load_scene


def open_scene(scene: str) -> Scene:
    """The scene of a command-line argument; "embedded" is made once and kept in the user's cache.

    Raises:
        SceneError: If the argument names no scene bundle.
    """
    if scene == "embedded":
        from common.scenes.embedded import ensure_embedded_scene

        return ensure_embedded_scene(cache_folder("scenes") / "embedded")
    return load_scene(Path(scene))
