"""The stages from a source to posed, undistorted, metric images: functions of files and settings, without a bus."""

import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.config import section_to_mapping
from readygo.common.documents import read_json
from readygo.common.drawing.files import write_png
from readygo.common.errors import ConfigError, SceneError
from readygo.services.reconstructor.config import ReconstructorConfig
from readygo.services.reconstructor.drawing import draw_map
from readygo.services.reconstructor.frames.config import FramesConfig
from readygo.services.reconstructor.frames.depths import FOLDER as DEPTHS
from readygo.services.reconstructor.frames.masks import FOLDER as MASKS
from readygo.services.reconstructor.frames.masks import mask_files, prepare_masks
from readygo.services.reconstructor.frames.names import image_order, usable_name
from readygo.services.reconstructor.frames.panorama import (
    cut_panoramas,
    is_panorama,
    panorama_width_px,
    view_rotations,
)
from readygo.services.reconstructor.frames.photos import prepare_photos
from readygo.services.reconstructor.frames.video import FRAMES_MIN, extract_frames
from readygo.services.reconstructor.given.depth import absent_modules
from readygo.services.reconstructor.given.find import prepare_capture, read_capture
from readygo.services.reconstructor.job import (
    DATABASE_FILE,
    FEATURES,
    FRAMES,
    MAP,
    MARKERS,
    MATCHES,
    PICTURE_FILE,
    POSED,
    REPORT_FILE,
    Source,
    images_of,
    images_of_model,
    in_order,
    open_source,
)
from readygo.services.reconstructor.mapping import make_map
from readygo.services.reconstructor.metric.config import MetricConfig
from readygo.services.reconstructor.metric.drift import drift, images_to_look_at
from readygo.services.reconstructor.metric.lengths import KnownLength, in_used_images, parse_length
from readygo.services.reconstructor.metric.markers import (
    MarkerSighting,
    open_dictionary,
    other_dictionaries,
    sightings_in,
)
from readygo.services.reconstructor.metric.place import NO_SCALE, Device, Placement, Ruler, place_map, scale_is_told
from readygo.services.reconstructor.metric.scale import TWO_SIDED_95, square_corners_m
from readygo.services.reconstructor.posed import PosedImages
from readygo.services.reconstructor.poses import colmap, undistortion
from readygo.services.reconstructor.poses.apart import apart
from readygo.services.reconstructor.poses.config import PosesConfig
from readygo.services.reconstructor.poses.covariance import pose_errors
from readygo.services.reconstructor.poses.depths import DepthRatio, check_unit, depth_ratio
from readygo.services.reconstructor.poses.intrinsics import Intrinsics, fit_to_images, read_intrinsics
from readygo.services.reconstructor.poses.pairs import image_pairs, view_pairs
from readygo.services.reconstructor.poses.tags import focal_of_tags, tag_features
from readygo.services.reconstructor.poses.verdict import PoseVerdict
from readygo.services.reconstructor.stages import Say, Stages, code_digest, identity_of

_FEATURES_MIN = 600
"""Where the median image of a video has fewer, fainter ones are taken too, of all images."""
_OVERLAP = 10
"""An image of a video is matched with this many that follow it, and with some that are far away."""
_TRIED_IMAGES = 40
"""Other dictionaries are looked for in about this many images."""


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
    """Begin a job in a state folder, or resume it, after a look at what would stop it hours later.

    Raises:
        ReadygoError: If the source cannot be used, the scale is not told, or another command works in the folder.
    """
    _check_settings(config)
    colmap.pycolmap()
    given = open_source(source)
    if not scale_is_told(config.metric) and not _measures_scale(given, depth=config.frames.depth):
        raise ConfigError(NO_SCALE)
    panoramas = config.frames.projection == "equirectangular"
    if config.poses.intrinsics and (given.kind in ("colmap", "capture") or panoramas):
        kind = "a 360-degree source" if panoramas else str(source)
        raise ConfigError(f"{kind} comes with its lenses; leave --intrinsics out.")
    if panoramas and given.kind in ("colmap", "capture"):
        raise ConfigError(f"{source} has poses of its images already; --equirectangular is for videos and photos.")
    stages = Stages(folder, say)
    with stages.alone():
        yield stages, given


def find_poses_in(stages: Stages, given: Source, config: ReconstructorConfig) -> dict[str, Any]:
    """Run the stages of `find_poses` in a job that may have further stages."""
    out = stages.folder
    poses, metric = section_to_mapping(config.poses), section_to_mapping(config.metric)
    settings = {"source": [str(given.path.resolve()), given.kind, given.identity], **section_to_mapping(config.frames)}
    code = code_digest(".", "frames", "given", "metric", "poses")
    if config.frames.masks:
        settings["mask_files"] = identity_of(mask_files(Path(config.frames.masks)))
    frames = stages.run(FRAMES, settings, partial(make_frames, given, config), code=code)
    lengths = known_lengths(frames, config.metric)
    folder = out / FRAMES
    seen: list[dict[str, Any]] = []
    if config.metric.marker_size_m:
        wanted = {"dictionary": config.metric.marker_dictionary}
        seen = stages.run(MARKERS, wanted, partial(make_markers, folder, frames, config))["sightings"]
    sightings = [MarkerSighting(**{**each, "corners_px": np.array(each["corners_px"])}) for each in seen]
    if given.kind != "colmap":
        known = known_lens(frames, config)
        told = {} if known is None else {"lens": [known.model, *known.params], "as": config.poses.intrinsics_are}
        stages.run(FEATURES, told, partial(make_features, folder, frames, sightings, given.kind, config))
        stages.run(
            MATCHES, {"seed": config.poses.seed}, partial(make_matches, out, frames, sightings, given.kind, config)
        )
    if "rig" in frames:
        config = replace(config, poses=replace(config.poses, intrinsics="of the views", intrinsics_are="fixed"))
    made = stages.run(MAP, {**poses, "tags": bool(sightings)}, partial(make_map, out, given, frames, sightings, config))
    place = partial(
        make_posed, out, out / MAP / made["model"], PoseVerdict(**made["verdict"]), sightings, lengths, config
    )
    report = stages.run(POSED, metric, place)
    return {"source": str(given.path), "kind": given.kind, "frames": frames, **report, "seconds": stages.seconds}


def _check_settings(config: ReconstructorConfig) -> None:
    """Before hours of work, not after them."""
    metric = config.metric
    open_dictionary(metric.marker_dictionary)
    if config.frames.masks:
        mask_files(Path(config.frames.masks))
    if config.poses.intrinsics:
        read_intrinsics(config.poses.intrinsics)
    for text in metric.lengths:
        parse_length(text)


def _measures_scale(given: Source, *, depth: bool) -> bool:
    """Whether images come with poses in metres, or with depths, where these are to be used."""
    capture = read_capture(given.path) if given.kind == "capture" else None
    if capture is None or capture.metric or not (depth and any(capture.depth)):
        return capture is not None and capture.metric
    return not absent_modules(capture.depth)


def make_frames(source: Source, config: ReconstructorConfig, folder: Path) -> Mapping[str, Any]:
    """The images that are used, their masks, and what they are."""
    found = _make_images(source, config, folder)
    if not config.frames.masks:
        return found
    place, names = images_of(found, folder)
    masked = prepare_masks(Path(config.frames.masks), place, names, found.get("photos", {}), folder / MASKS)
    return {**found, **masked, "notes": [*found.get("notes", []), *masked["notes"]]}


def _make_images(source: Source, config: ReconstructorConfig, folder: Path) -> dict[str, Any]:
    """The images that are used, and what they are."""
    if source.kind in ("video", "photos"):
        found = _make_views(source, config.frames, folder)
    elif source.kind == "capture":
        given = read_capture(source.path)
        assert given is not None
        found = prepare_capture(given, folder, config.frames)
    else:
        model = colmap.find_model(source.path)
        assert model is not None
        return {"kept": 0, "names": colmap.image_names(model), "images": str(images_of_model(source.path))}
    written = (path.relative_to(folder).as_posix() for path in folder.rglob("*.jpg"))
    return {**found, "names": sorted(written, key=image_order)}


def _make_views(source: Source, config: FramesConfig, folder: Path) -> dict[str, Any]:
    """The images of a video or of photos; views of those that show 360 degrees."""
    prepare = extract_frames if source.kind == "video" else prepare_photos
    if config.projection == "perspective":
        found = prepare(source.path, folder, config)
        size = found["size_px"]
        if not isinstance(size[0], list) and is_panorama(size):
            note = "images are twice as wide as high: if they show 360 degrees, give --equirectangular"
            found["notes"] = [*found.get("notes", []), note]
        return found
    frames_max = max(FRAMES_MIN, config.count_max // len(view_rotations()))
    whole = replace(config, count_max=frames_max, side_max_px=panorama_width_px(config.side_max_px))
    return cut_panoramas(folder, prepare(source.path, folder, whole))


def known_lengths(frames: Mapping[str, Any], config: MetricConfig) -> list[KnownLength]:
    """The lengths that were told, in pixels of the images that are used.

    Raises:
        ConfigError: If one names an image that there is not.
    """
    used = {name: (name, 1.0) for name in images_of(frames, Path())[1]}
    used |= {name: (str(kept), float(share)) for name, (kept, share) in frames.get("photos", {}).items()}
    # Picks are separated by spaces, so names are told without them.
    used = {usable_name(name): place for name, place in used.items()} | used
    return [in_used_images(parse_length(text), used) for text in config.lengths]


def make_markers(
    images: Path, frames: Mapping[str, Any], config: ReconstructorConfig, folder: Path
) -> Mapping[str, Any]:
    """Every marker in every image.

    Raises:
        SceneError: If there is none; other dictionaries that have one are named.
    """
    dictionary = config.metric.marker_dictionary
    place, names = images_of(frames, images)
    found = sightings_in(place, names, dictionary)
    if not found:
        some = names[:: max(1, len(names) // _TRIED_IMAGES)]
        others = other_dictionaries(place, some, dictionary)
        remedy = f"found instead: {'; '.join(others)}" if others else "no other dictionary has one either"
        raise SceneError(f"No image shows a marker of {dictionary}; {remedy}. Name it with --metric.marker-dictionary.")
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
    wanted = {"focal_px": focal_px, "size_px": size_px, "features_min": _FEATURES_MIN if kind == "video" else 0}
    wanted["masks"] = images / MASKS if (images / MASKS).is_dir() else None
    wanted["lens"] = _given_lenses(frames) or known_lens(frames, config)
    wanted["rig"] = rig_of(frames)
    apart(colmap.extract_features, database, images, names, config.poses, **wanted)
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
    pairs = _name_pairs(names, rig_of(frames), kind, config)
    apart(colmap.match_features, database, pairs, config.poses)
    if sightings:
        colmap.add_tag_matches(database, tag_features(sightings), config.poses)
    return {"pairs": len(pairs)}


def _name_pairs(
    names: list[str], rig: Mapping[str, Float64Array] | None, kind: str, config: ReconstructorConfig
) -> list[tuple[str, str]]:
    """Names of the images that are matched with each other."""
    if rig is None:
        sequential = in_order(kind, len(names), config)
        return [(names[a], names[b]) for a, b in image_pairs(len(names), sequential=sequential, overlap=_OVERLAP)]
    panoramas = sorted({Path(name).name for name in names}, key=image_order)
    sequential = in_order(kind, len(panoramas), config)
    pairs = image_pairs(len(panoramas), sequential=sequential, overlap=_OVERLAP)
    near = _OVERLAP if sequential else 0
    return [
        (f"{one}/{panoramas[a]}", f"{other}/{panoramas[b]}")
        for a, b in pairs
        for one, other in view_pairs(rig, near=b - a <= near)
    ]


def rig_of(frames: Mapping[str, Any]) -> dict[str, Float64Array] | None:
    """Rotations `R_panorama_view` by folder of the views of 360-degree images; None for other images."""
    return {name: np.array(R) for name, R in frames["rig"].items()} if "rig" in frames else None


def _given_lenses(frames: Mapping[str, Any]) -> Intrinsics | dict[str, Intrinsics] | None:
    """The lenses that came with the images: one, or one by image; None if they came without."""
    lenses = {
        name: Intrinsics(model=model, params=tuple(params)) for name, (model, *params) in frames.get("lens", {}).items()
    }
    one = len(set(lenses.values())) == 1 and not isinstance(frames["size_px"][0], list)
    return next(iter(lenses.values())) if one else lenses or None


def known_lens(frames: Mapping[str, Any], config: ReconstructorConfig) -> Intrinsics | None:
    """The lens that the user gave, for the images that are used; None if none was given.

    Raises:
        ConfigError: If it cannot be read, or is for other images.
    """
    if not config.poses.intrinsics:
        return None
    given = read_intrinsics(config.poses.intrinsics)
    if not frames.get("source_px"):
        raise ConfigError("--intrinsics need images of one size; sort photos of other cameras out.")
    (width, height), (used_width, used_height) = frames["source_px"], frames["size_px"]
    turned_deg = int(frames.get("turned_deg", 0))
    return fit_to_images(given, (width, height), (used_width, used_height), turned_deg=turned_deg)


def _focal_of_tags(frames: Mapping[str, Any], sightings: list[MarkerSighting]) -> float:
    size_px = frames["size_px"]
    if not sightings or isinstance(size_px[0], list):
        return 0.0
    return focal_of_tags(sightings, {each.image: tuple(size_px) for each in sightings}) or 0.0


def make_posed(
    out: Path,
    model: Path,
    verdict: PoseVerdict,
    sightings: list[MarkerSighting],
    lengths: list[KnownLength],
    config: ReconstructorConfig,
    folder: Path,
) -> Mapping[str, Any]:
    """Undistorted images, masks and depth images, and the metric model, a picture from above, and the report."""
    frames = read_json(out / FRAMES / "stage.json")["found"]
    place, _ = images_of(frames, out / FRAMES)
    images = colmap.read_map(model)
    find_drift = partial(_drift_beside, model, images, adjusted_as(frames, config.poses))
    ratio = depth_ratio(model, out / FRAMES / DEPTHS) if frames.get("depths") else None
    if ratio is not None and frames["metric"]:
        check_unit(ratio)
    placed = place_map(images, sightings, lengths, config.metric, device_of(frames, ratio), find_drift)
    apart(undistortion.write_undistorted, model, place, folder, placed.world_from_map, config.poses)
    if (out / FRAMES / MASKS).is_dir():
        undistortion.write_undistorted_masks(model, out / FRAMES / MASKS, folder)
    if ratio is not None:
        scale = ratio.units_per_metre * placed.scale.metres_per_unit
        undistortion.write_undistorted_depths(model, out / FRAMES / DEPTHS, folder, scale)
    metric = images.transform(placed.world_from_map)
    corners_m = [placed.world_from_map.apply(marker.corners) for marker in placed.markers]
    write_png(
        folder / PICTURE_FILE, draw_map(metric, {m.marker: c for m, c in zip(placed.markers, corners_m, strict=True)})
    )
    report = {"verdict": {**asdict(verdict), "registered_share": verdict.registered_share, "drift": verdict.drift}}
    numbers = _placement_numbers(placed, config)
    if frames.get("unused"):
        names = ", ".join(frames["unused"])
        numbers["notes"].append(f"not used, as they cannot be read or are no photos like the others: {names}")
    report |= numbers
    if frames.get("depths"):
        report["depth"] = _depth_numbers(frames, ratio, placed.scale.metres_per_unit)
        numbers["notes"].append(report["depth"].pop("note"))
    numbers["notes"] += frames.get("notes", [])
    (folder / REPORT_FILE).write_text(json.dumps(report, indent=2) + "\n")
    return report


def adjusted_as(frames: Mapping[str, Any], config: PosesConfig) -> PosesConfig:
    """How the map was adjusted: lenses that came with the images' poses stay as they are."""
    return replace(config, intrinsics="given", intrinsics_are="fixed") if "pose" in frames else config


def device_of(frames: Mapping[str, Any], ratio: DepthRatio | None = None) -> Device:
    """What the device that filmed measured itself: its depths tell the scale of poses that have none."""
    name, metric = str(frames.get("what", "")), bool(frames.get("metric"))
    by_depths = ratio is not None and not metric
    return Device(
        name=f"depth images of {name}" if by_depths else name,
        metric=metric or by_depths,
        metres_per_unit=1.0 / ratio.units_per_metre if ratio is not None and by_depths else 1.0,
        up=None if frames.get("up") is None else np.array(frames["up"], dtype=np.float64),
    )


def _depth_numbers(frames: Mapping[str, Any], ratio: DepthRatio | None, metres_per_unit: float) -> dict[str, Any]:
    """What the report says of depth images, and a note."""
    images = int(frames["depths"])
    if ratio is None:
        return {"images": images, "note": "depth images are not used: too few points of the map have a depth"}
    longer = 1.0 / (ratio.units_per_metre * metres_per_unit)
    note = f"check: depths of the device are {100 * (longer - 1):+.1f} % longer than those of {ratio.sightings} points"
    return {"images": images, "sightings": ratio.sightings, "longer_than_map": round(longer, 5),
            "spread": round(ratio.spread, 5), "note": f"{note} in {ratio.images} images"}  # fmt: skip


def _drift_beside(model: Path, images: PosedImages, poses: PosesConfig, ruler: Ruler) -> float | None:
    """How far a map may be bent beside what told its scale, see `drift`; None if it cannot be told."""
    errors = apart(pose_errors, model, images_to_look_at(images.names, ruler.images), poses)
    return None if errors is None else drift(images, errors, ruler.measure, ruler.images)


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
                  "interval_percent": round(100.0 * scale.half_interval, 3) if measured else None,
                  "drift_percent": round(100.0 * TWO_SIDED_95 * scale.drift, 3) if measured else None},
        "up": placed.floor.source,
        "markers": markers,
        "notes": list(placed.warnings),
    }  # fmt: skip
