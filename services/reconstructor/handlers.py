"""The stages from a source to posed, undistorted, metric images: functions of files and settings, without a bus."""

import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from readygo.common.config import section_to_mapping
from readygo.common.drawing.files import write_png
from readygo.common.errors import ConfigError, SceneError
from readygo.services.reconstructor.config import MetricConfig, PosesConfig, ReconstructorConfig
from readygo.services.reconstructor.drawing import draw_map
from readygo.services.reconstructor.frames.photos import photo_files, prepare_photos
from readygo.services.reconstructor.frames.video import extract_frames
from readygo.services.reconstructor.metric.lengths import KnownLength, in_used_images, parse_length
from readygo.services.reconstructor.metric.markers import (
    MarkerSighting,
    open_dictionary,
    other_dictionaries,
    sightings_in,
)
from readygo.services.reconstructor.metric.place import Placement, place_map
from readygo.services.reconstructor.metric.scale import square_corners_m
from readygo.services.reconstructor.posed import PosedImages
from readygo.services.reconstructor.poses import colmap
from readygo.services.reconstructor.poses.apart import apart
from readygo.services.reconstructor.poses.joining import placed_by_markers
from readygo.services.reconstructor.poses.pairs import image_pairs
from readygo.services.reconstructor.poses.squares import adjusted_by_squares
from readygo.services.reconstructor.poses.tags import focal_of_tags, tag_features
from readygo.services.reconstructor.poses.verdict import ADVICE, DOUBTFUL_POINTS, Verdict, disagreement, judge, refusal
from readygo.services.reconstructor.stages import Say, Stages, code_digest

FRAMES, MARKERS, FEATURES, MATCHES, MAP, POSED = "frames", "markers", "features", "matches", "map", "posed"
"""Stages, and folders of the job."""
POSE_STAGES = (FRAMES, MARKERS, FEATURES, MATCHES, MAP, POSED)
DATABASE_FILE, PICTURE_FILE, REPORT_FILE = "database.db", "top.png", "poses.json"
REPEATS = 2
"""So often a doubtful map is made again."""
_TRIED_IMAGES = 40
"""Of so many images other dictionaries are looked for."""


@dataclass(frozen=True, kw_only=True)
class Source:
    """What a job begins with."""

    path: Path
    kind: str
    """video, photos or colmap."""
    identity: tuple[tuple[str, int, int], ...]
    """Name, size and time of change of each file."""


def open_source(path: Path) -> Source:
    """Tell what a path is.

    Raises:
        SceneError: If it is nothing to begin with.
    """
    if not path.exists():
        raise SceneError(f"{path} does not exist; give a video, a folder of photos or a folder with a COLMAP model.")
    if path.is_file():
        return Source(path=path, kind="video", identity=_identity([path]))
    model = colmap.find_model(path)
    if model is not None:
        return Source(path=path, kind="colmap", identity=_identity(sorted(model.iterdir())))
    photos = photo_files(path)
    if not photos:
        raise SceneError(f"{path} holds no photos (.jpg, .png, .tif, ...) and no COLMAP model.")
    return Source(path=path, kind="photos", identity=_identity(photos))


def _identity(files: list[Path]) -> tuple[tuple[str, int, int], ...]:
    return tuple((path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in files if path.is_file())


def find_poses(source: Path, out: Path, config: ReconstructorConfig, say: Say) -> dict[str, Any]:
    """Run all stages that are not done yet, and give the report, which is also in `out`/poses.json.

    Args:
        source: A video, a folder of photos, or a folder with a COLMAP model and its images.
        out: State folder; what is finished there is not done again.
        config: How.
        say: Hears when a stage begins.

    Raises:
        ReadygoError: If the source cannot be used, the map is bad, or the scale is not known.
    """
    with open_job(source, out, config, say) as (stages, given):
        return find_poses_in(stages, given, config)


@contextmanager
def open_job(source: Path, folder: Path, config: ReconstructorConfig, say: Say) -> Iterator[tuple[Stages, Source]]:
    """Begin a job in a state folder, or go on with it, after a look at what would stop it hours later.

    Raises:
        ReadygoError: If the source cannot be used, the scale is not told, or another command works in the folder.
    """
    _check_scale_is_told(config)
    colmap.pycolmap()
    given = open_source(source)
    stages = Stages(folder, say)
    with stages.alone():
        yield stages, given


def find_poses_in(stages: Stages, given: Source, config: ReconstructorConfig) -> dict[str, Any]:
    """As `find_poses`, in a job that may go on after it."""
    out = stages.folder
    poses, metric = section_to_mapping(config.poses), section_to_mapping(config.metric)
    settings = {"source": [str(given.path.resolve()), given.kind, given.identity], **section_to_mapping(config.frames)}
    code = code_digest(".", "frames", "metric", "poses")
    frames = stages.run(FRAMES, settings, partial(make_frames, given, config), code=code)
    lengths = known_lengths(frames, config.metric)
    folder = out / FRAMES
    seen: list[dict[str, Any]] = []
    if config.metric.marker_size_m:
        wanted = {"dictionary": config.metric.marker_dictionary}
        seen = stages.run(MARKERS, wanted, partial(make_markers, folder, frames, config))["sightings"]
    sightings = [MarkerSighting(**{**each, "corners_px": np.array(each["corners_px"])}) for each in seen]
    if given.kind != "colmap":
        looked_for = _some(poses, "features_max", "features_min")
        stages.run(FEATURES, looked_for, partial(make_features, folder, frames, sightings, given.kind, config))
        compared = _some(poses, "overlap", "exhaustive_max", "seed")
        stages.run(MATCHES, compared, partial(make_matches, out, frames, sightings, given.kind, config))
    made = stages.run(MAP, {**poses, "tags": bool(sightings)}, partial(make_map, out, given, frames, sightings, config))
    place = partial(make_posed, out, out / MAP / made["model"], Verdict(**made["verdict"]), sightings, lengths, config)
    report = stages.run(POSED, metric, place)
    return {"source": str(given.path), "kind": given.kind, "frames": frames, **report, "seconds": stages.seconds}


def _some(settings: Mapping[str, Any], *names: str) -> dict[str, Any]:
    return {name: settings[name] for name in names}


def _check_scale_is_told(config: ReconstructorConfig) -> None:
    """Before hours of work, not after them."""
    metric = config.metric
    if not (metric.marker_size_m or metric.lengths or metric.scale):
        raise ConfigError(
            "Nothing tells the scale: give --marker-size-m for a printed marker (`readygo marker` makes one), "
            "--length between two points, or --scale."
        )
    open_dictionary(metric.marker_dictionary)
    for text in metric.lengths:
        parse_length(text)


def make_frames(source: Source, config: ReconstructorConfig, folder: Path) -> Mapping[str, Any]:
    """The images that are used, and what they are."""
    if source.kind == "video":
        found = extract_frames(source.path, folder, config.frames)
    elif source.kind == "photos":
        found = prepare_photos(source.path, folder, config.frames)
    else:
        return {"kept": 0, "names": [], "images": str(_images_of_model(source.path))}
    return {**found, "names": sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*.jpg"))}


def _images_of_model(path: Path) -> Path:
    folder = path / "images"
    if not folder.is_dir():
        raise SceneError(f"{path} holds a COLMAP model but no folder images/.")
    return folder.resolve()


def _images(frames: Mapping[str, Any], folder: Path) -> tuple[Path, list[str]]:
    """Where images are, and their names."""
    if "images" not in frames:
        return folder, list(frames["names"])
    place = Path(frames["images"])
    return place, sorted(p.relative_to(place).as_posix() for p in place.rglob("*") if p.is_file())


def known_lengths(frames: Mapping[str, Any], config: MetricConfig) -> list[KnownLength]:
    """The lengths that were told, in pixels of the images that are used.

    Raises:
        ConfigError: If one names an image that there is not.
    """
    used = {name: (name, 1.0) for name in _images(frames, Path())[1]}
    used |= {name: (str(kept), float(share)) for name, (kept, share) in frames.get("photos", {}).items()}
    return [in_used_images(parse_length(text), used) for text in config.lengths]


def make_markers(
    images: Path, frames: Mapping[str, Any], config: ReconstructorConfig, folder: Path
) -> Mapping[str, Any]:
    """Every marker in every image.

    Raises:
        SceneError: If there is none; other dictionaries that have one are named.
    """
    dictionary = config.metric.marker_dictionary
    place, names = _images(frames, images)
    found = sightings_in(place, names, dictionary)
    if not found:
        some = names[:: max(1, len(names) // _TRIED_IMAGES)]
        others = other_dictionaries(place, some, dictionary)
        remedy = f"found instead: {'; '.join(others)}" if others else "no other dictionary has one either"
        raise SceneError(f"No image shows a marker of {dictionary}; {remedy}. Name it with --marker-dictionary.")
    return {"sightings": [{**asdict(each), "corners_px": each.corners_px.tolist()} for each in found]}


def make_features(
    images: Path,
    frames: Mapping[str, Any],
    sightings: list[MarkerSighting],
    kind: str,
    config: ReconstructorConfig,
    folder: Path,
) -> Mapping[str, Any]:
    """The database of features; the focal length is EXIF's, else that which makes markers square.

    Faint features are looked for in videos alone: large photos of bare surfaces have thousands of them.
    """
    focal_px = float(frames.get("focal_px") or 0.0) or _focal_of_tags(frames, sightings)
    database, names, size_px = folder / DATABASE_FILE, list(frames["names"]), frames["size_px"]
    poses = config.poses if kind == "video" else replace(config.poses, features_min=0)
    apart(colmap.extract_features, database, images, names, poses, focal_px=focal_px, size_px=size_px)
    return {"focal_px": focal_px}


def make_matches(
    out: Path,
    frames: Mapping[str, Any],
    sightings: list[MarkerSighting],
    kind: str,
    config: ReconstructorConfig,
    folder: Path,
) -> Mapping[str, Any]:
    """The database with matches; points of markers are among them."""
    names = list(frames["names"])
    database = folder / DATABASE_FILE
    shutil.copyfile(out / FEATURES / DATABASE_FILE, database)
    pairs = image_pairs(len(names), sequential=_in_order(kind, len(names), config), overlap=config.poses.overlap)
    apart(colmap.match_features, database, [(names[a], names[b]) for a, b in pairs], config.poses)
    if sightings:
        colmap.add_tag_matches(database, tag_features(sightings), config.poses)
    return {"pairs": len(pairs)}


def _focal_of_tags(frames: Mapping[str, Any], sightings: list[MarkerSighting]) -> float:
    size_px = frames["size_px"]
    if not sightings or isinstance(size_px[0], list):
        return 0.0
    return focal_of_tags(sightings, {each.image: tuple(size_px) for each in sightings}) or 0.0


def _in_order(kind: str, count: int, config: ReconstructorConfig) -> bool:
    return kind == "video" or (kind == "photos" and count > config.poses.exhaustive_max)


def make_map(
    out: Path,
    source: Source,
    frames: Mapping[str, Any],
    sightings: list[MarkerSighting],
    config: ReconstructorConfig,
    folder: Path,
) -> Mapping[str, Any]:
    """Poses and points in units of their own, judged.

    Raises:
        SceneError: If the map must not be used; the message has advice.
    """
    database = out / MATCHES / DATABASE_FILE
    few_matches = False
    if source.kind == "colmap":
        model = colmap.find_model(source.path)
        assert model is not None
        sizes = colmap.piece_sizes([model])
        asked = sizes[0]
        name = str(model.resolve())
    else:
        asked = len(frames["names"])
        models, few_matches = _maps(database, out / FRAMES, folder, config.poses, count=asked, tags=bool(sightings))
        if not models:
            nothing = replace(_NOTHING, images=asked)
            raise SceneError(str(refusal(nothing, registered_min=config.poses.registered_min)))
        models = _joined(models, database, out / FRAMES, sightings, config)
        model, sizes, name = models[0], colmap.piece_sizes(models), str(models[0].relative_to(folder))
    images = colmap.read_map(model)
    verdict = judge(images, asked=asked, components=sizes, sequential=_in_order(source.kind, asked, config))
    reason = refusal(verdict, registered_min=config.poses.registered_min)
    doubtful = few_matches or verdict.points_per_image < DOUBTFUL_POINTS
    if not reason and source.kind != "colmap" and not sightings and doubtful:
        reason = _contradiction(images, database, out / FRAMES, folder, config.poses, few_matches=few_matches)
    if reason:
        raise SceneError(reason)
    return {"model": name, "verdict": {**asdict(verdict), "components": list(sizes)}}


def _maps(
    database: Path, photos: Path, folder: Path, config: PosesConfig, *, count: int, tags: bool
) -> tuple[list[Path], bool]:
    """The maps, the largest first, and whether they are a second attempt.

    Where too few images have a pose, a second attempt takes those with fewer matches too. These can be chance, so what
    comes of it must come out the same with other seeds.
    """
    models = colmap.build_maps(database, photos, folder, config, count=count, few_matches=tags)
    enough = sum(colmap.piece_sizes(models[:1])) >= config.registered_min * count
    if enough or tags or config.mapper_of(count) == "global":
        return models, False
    again = folder / "few_matches"
    again.mkdir()
    return colmap.build_maps(database, photos, again, config, count=count, few_matches=True) or models, True


def _contradiction(
    images: PosedImages, database: Path, photos: Path, folder: Path, config: PosesConfig, *, few_matches: bool
) -> str | None:
    """Why a map must not be used that comes out differently with other seeds."""
    for number in range(1, REPEATS + 1):
        with TemporaryDirectory(dir=folder) as other:
            again, count = replace(config, seed=config.seed + number), len(images.names)
            models = colmap.build_maps(database, photos, Path(other), again, count=count, few_matches=few_matches)
            reason = disagreement(images, colmap.read_map(models[0]) if models else None)
        if reason:
            return f"The images share too little to tell how they lie: {reason}. {ADVICE}"
    return None


def _joined(
    models: list[Path], database: Path, images: Path, sightings: list[MarkerSighting], config: ReconstructorConfig
) -> list[Path]:
    """The models with that first which markers make of all pieces and of images without a pose, if there is more.

    Where images share little besides markers, these are made squares of one size.
    """
    pieces = [colmap.read_map(model) for model in models]
    one_camera = len({tuple(size) for piece in pieces for size in piece.size_px.tolist()}) == 1
    if not (sightings and one_camera):
        return models
    poses = placed_by_markers(pieces, sightings)
    if len(poses) > len(pieces[0].names):
        folder = models[0].parent / "joined"
        models = [apart(colmap.posed_model, database, images, folder, models[0], poses, config.poses), *models]
    whole = colmap.read_map(models[0])
    if not _hangs_by_markers(whole, sightings):
        return models
    squared, focal = adjusted_by_squares(whole, dict(zip(whole.names, whole.T_world_camera, strict=True)), sightings)
    folder = models[0].parent / "squared"
    made = apart(colmap.posed_model, database, images, folder, models[0], squared, config.poses, focal=focal)
    return [made, *models]


def _hangs_by_markers(images: PosedImages, sightings: list[MarkerSighting]) -> bool:
    """Whether every image shows a marker, and few points besides."""
    per_image = np.bincount(images.seen[:, 0], minlength=len(images.names))
    return set(images.names) <= {each.image for each in sightings} and float(np.median(per_image)) < DOUBTFUL_POINTS


_NOTHING = Verdict(
    images=0,
    registered=0,
    components=(),
    points=0,
    reprojection_px=0.0,
    points_per_image=0.0,
    weakest_link=0,
    loops=0,
    sequential=False,
)


def make_posed(
    out: Path,
    model: Path,
    verdict: Verdict,
    sightings: list[MarkerSighting],
    lengths: list[KnownLength],
    config: ReconstructorConfig,
    folder: Path,
) -> Mapping[str, Any]:
    """Undistorted images and the metric model, a picture from above, and the report."""
    frames = json.loads((out / FRAMES / "stage.json").read_text())["found"]
    place, _ = _images(frames, out / FRAMES)
    images = colmap.read_map(model)
    placed = place_map(images, sightings, lengths, config.metric)
    apart(colmap.write_undistorted, model, place, folder, placed.world_from_map, config.poses)
    metric = images.moved(placed.world_from_map)
    corners_m = [placed.world_from_map.apply(marker.corners) for marker in placed.markers]
    write_png(
        folder / PICTURE_FILE, draw_map(metric, {m.marker: c for m, c in zip(placed.markers, corners_m, strict=True)})
    )
    report = {"verdict": {**asdict(verdict), "registered_share": verdict.registered_share, "drift": verdict.drift}}
    report |= _placement_numbers(placed, config)
    (folder / REPORT_FILE).write_text(json.dumps(report, indent=2) + "\n")
    return report


def _placement_numbers(placed: Placement, config: ReconstructorConfig) -> dict[str, Any]:
    """What the report says of scale and floor."""
    scale = placed.scale
    measured = scale.sigma == scale.sigma
    low, high = scale.interval
    size_m = config.metric.marker_size_m
    markers = []
    for marker in placed.markers:
        corners = placed.world_from_map.apply(marker.corners)
        sides_m = np.linalg.norm(corners - np.roll(corners, -1, axis=0), axis=1)
        fitted = placed.world_from_map.apply(marker.map_from_marker.apply(square_corners_m(size_m)))
        markers.append({"marker": marker.marker, "views": marker.views, "residual_px": round(marker.residual_px, 3),
                        "side_m": round(float(sides_m.mean()), 5), "sides_m": np.round(sides_m, 5).tolist(),
                        "centre_m": np.round(fitted.mean(axis=0), 4).tolist()})  # fmt: skip
    return {
        "scale": {"metres_per_unit": scale.metres_per_unit, "source": scale.source,
                  "low": low if measured else None, "high": high if measured else None,
                  "interval_percent": round(196.0 * scale.sigma, 3) if measured else None},
        "up": placed.floor.source,
        "markers": markers,
        "notes": list(placed.warnings),
    }  # fmt: skip
