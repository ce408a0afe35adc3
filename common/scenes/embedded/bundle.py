"""The embedded scene as a bundle on disk, made when it is first needed."""

import hashlib
from collections.abc import Callable
from pathlib import Path

import readygo.common.maps
from readygo.common.errors import SceneError
from readygo.common.files import unfinished_folder
from readygo.common.gaussians import GaussianCloud
from readygo.common.maps import MapConfig
from readygo.common.robot import RobotConfig
from readygo.common.scenes.bundle import SceneSource, fill_bundle
from readygo.common.scenes.embedded.scene import drawn_scene_cloud, embedded_scene_cloud, embedded_sky
from readygo.common.scenes.manifest import MANIFEST
from readygo.common.scenes.scene import Scene, load_scene

NAME = "embedded"
LICENSE = "made by readygo's own code; free for every use"
_FILE = "readygo embedded scene"


def ensure_embedded_scene(folder: str | Path, seed: int = 0, *, own_plan: bool = False) -> Scene:
    """The bundle of the embedded scene in `folder`, made if it is missing and made again if it is out of date.

    Several processes may call this at once: each finds or makes a complete bundle.

    Args:
        folder: Where the bundle is kept.
        seed: Which flat, as in `embedded_scene_cloud`.
        own_plan: True for a flat whose plan is drawn, as in `drawn_scene_cloud`.

    Raises:
        SceneError: If `folder` holds something else, or cannot be written.
    """
    folder, name = Path(folder), scene_name(seed, own_plan=own_plan)
    recipe = recipe_hash(name)
    scene = _current(folder, recipe)
    if scene is not None:
        return scene
    return _make(folder, recipe, name, lambda: drawn_scene_cloud(seed) if own_plan else embedded_scene_cloud(seed))


def scene_name(seed: int, *, own_plan: bool = False) -> str:
    """Name of a flat: "embedded", "embedded-1", ... or "embedded-plan-1"."""
    if own_plan:
        return f"{NAME}-plan-{seed}"
    return NAME if seed == 0 else f"{NAME}-{seed}"


def recipe_hash(name: str = NAME) -> str:
    """Hash of a flat's name and of the code that makes scene and maps: equal recipes give equal bundles."""
    digest = hashlib.sha256(f"{name}\n".encode())
    for package in (Path(__file__).parent, Path(readygo.common.maps.__file__).parent):
        for path in sorted(package.glob("*.py")):
            digest.update(f"{package.name}/{path.name}\n".encode() + path.read_bytes())
    return digest.hexdigest()


def _current(folder: Path, recipe: str) -> Scene | None:
    """The bundle in `folder` if it is intact and of this recipe; None where it may be replaced."""
    if not folder.exists():
        return None
    if folder.is_dir() and not any(folder.iterdir()):
        return None
    if not (folder / MANIFEST).is_file():
        raise SceneError(f"{folder} holds something else than a scene; move it away, or choose another folder.")
    try:
        scene = load_scene(folder)
    except SceneError:
        return None
    source = scene.metadata.get("source", {})
    if source.get("file") != _FILE:
        raise SceneError(f"{folder} holds another scene ({scene.name!r}); choose another folder.")
    return scene if source.get("sha256") == recipe else None


def _make(folder: Path, recipe: str, name: str, make: Callable[[], GaussianCloud]) -> Scene:
    robot = RobotConfig()
    with unfinished_folder(folder, good=lambda: _current(folder, recipe), raises=SceneError) as made:
        fill_bundle(
            made,
            make(),
            embedded_sky(),
            name=name,
            license=LICENSE,
            source=SceneSource(file=_FILE, sha256=recipe, scale_origin="made in metres"),
            robot=robot,
            map_config=MapConfig(robot_height_m=robot.height_m),
        )
    return load_scene(folder)
