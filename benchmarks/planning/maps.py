"""The maps that planning is measured on: scene bundles, Gaussian files, robots' maps, city maps; found by name."""

import hashlib
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from readygo.benchmarks.planning.movingai import load_movingai_map
from readygo.common.errors import ConfigError, SceneError
from readygo.common.files import cache_folder
from readygo.common.scenes import import_scene
from readygo.runs import scene_argument
from readygo.runs.scene_argument import FlatMaps, open_scene
from readygo.services.planner import PlanningMaps

ROOT = Path(__file__).resolve().parents[2]
SHORT_NAMES = {"willow": "willow-full-0.05", "home": "UMA_236_237"}
"""An office building and a home, both mapped by robots."""
GAUSSIAN_FILES = (".compressed.ply", ".ply")
MAP_FILES = (".yaml", ".map")
SKY_ENDING = "_env"
"""A scene's sky lies beside it as NAME_env.ply or NAME_env.compressed.ply."""
SCENE_CELL_M = {"taebak": 0.1}
"""Edge of map cells where it is not the usual 0.05 m [m]: the camp site spans 490 x 200 m, in Gaussians of 0.3 m."""
CITY_CELL_M = 0.2
"""Edge that cells of MovingAI maps are given [m]; the files do not say."""


@dataclass(frozen=True, kw_only=True)
class MapSource:
    """Where the maps of one place come from."""

    name: str
    path: str
    """Scene bundle, map file, or "embedded"."""


def default_data_folder() -> Path | None:
    """`../shared/data` beside the checkout, if it is there."""
    folder = ROOT.parent / "shared" / "data"
    return folder if folder.is_dir() else None


def find_map(name: str, data: Path | None) -> MapSource:
    """What a name stands for: "embedded", a scene bundle, a map file, or something in the data folder.

    Args:
        name: The name; of a bare one, NAME.yaml and NAME.map are looked for below `data`, then scenes/NAME.ply and
            scenes/NAME.compressed.ply, which are imported into the user's cache when they are first needed.
        data: Folder of scenes and maps.

    Raises:
        ConfigError: If there is no such map.
        SceneError: If a scene cannot be imported.
    """
    path = Path(name)
    if name == "embedded":
        open_scene(name)
        return MapSource(name=name, path=name)
    if path.is_dir() or (path.suffix in MAP_FILES and path.is_file()):
        return MapSource(name=path.stem, path=str(path.resolve()))
    if data is not None and path.name == name:
        for found in _maps_below(data):
            if found.stem == SHORT_NAMES.get(name, name):
                return MapSource(name=name, path=str(found))
        for found in _gaussian_files(data, name):
            return MapSource(
                name=name, path=str(_import_map(name, found, next(_gaussian_files(data, name + SKY_ENDING), None)))
            )
    raise ConfigError(_unknown(name, data))


def open_maps(source: MapSource) -> PlanningMaps:
    """The maps of a source.

    Raises:
        SceneError: If they cannot be read.
    """
    if source.path.endswith(".map"):
        return FlatMaps(load_movingai_map(source.path, CITY_CELL_M))
    return scene_argument.open_maps(source.path)[0]


def _maps_below(data: Path) -> list[Path]:
    return sorted(path for ending in MAP_FILES for path in (data / "maps").rglob(f"*{ending}"))


def _gaussian_files(data: Path, name: str) -> Iterator[Path]:
    paths = (data / "scenes" / f"{name}{ending}" for ending in GAUSSIAN_FILES)
    return (path for path in paths if path.is_file())


def _unknown(name: str, data: Path | None) -> str:
    if data is None:
        return f"Unknown map {name!r}: give a scene bundle, a map .yaml, or a data folder with --data."
    scenes = {path.name.split(".")[0] for ending in GAUSSIAN_FILES for path in (data / "scenes").glob(f"*{ending}")}
    names = {*(s for s in scenes if not s.endswith(SKY_ENDING)), *(path.stem for path in _maps_below(data))}
    known = ", ".join(sorted(names | (SHORT_NAMES.keys() if names else set()))) or "nothing"
    return f"Unknown map {name!r}: neither a scene bundle nor a map file, and {data} holds {known}."


def _import_map(name: str, source: Path, sky: Path | None) -> Path:
    """The bundle of a Gaussian file in the user's cache, made again when the file or the code of maps has changed."""
    digest = hashlib.sha256()
    makers = [*(ROOT / "common" / "maps").glob("*.py"), ROOT / "common" / "scenes" / "bundle.py"]
    cell_m = SCENE_CELL_M.get(name, 0.05)
    digest.update(str(cell_m).encode())
    for path in (source, *([sky] if sky is not None else []), *sorted(makers)):
        digest.update(path.read_bytes())
    folder = cache_folder("bench-scenes") / f"{name}-{digest.hexdigest()[:12]}"
    if folder.is_dir():
        return folder
    sys.stderr.write(f"importing {source.name} into {folder}\n")
    try:
        import_scene(source, folder, name=name, sky=sky, resolution_m=cell_m)
    except SceneError:
        # Another process may have been faster.
        if not folder.is_dir():
            raise
    return folder
