"""The stage from matches to a map: poses and points in arbitrary units, put together and judged."""

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from readygo.common.errors import SceneError
from readygo.services.reconstructor.config import ReconstructorConfig
from readygo.services.reconstructor.job import DATABASE_FILE, FRAMES, MATCHES, Source, in_order
from readygo.services.reconstructor.metric.markers import MarkerSighting
from readygo.services.reconstructor.posed import PosedImages
from readygo.services.reconstructor.poses import colmap
from readygo.services.reconstructor.poses.apart import apart
from readygo.services.reconstructor.poses.config import PosesConfig
from readygo.services.reconstructor.poses.joining import placed_by_markers
from readygo.services.reconstructor.poses.squares import adjusted_by_squares
from readygo.services.reconstructor.poses.verdict import (
    ADVICE,
    DOUBTFUL_POINTS,
    REGISTERED_MIN,
    PoseVerdict,
    disagreement,
    judge,
    refusal,
)

_NOTHING = PoseVerdict(
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
REPEATS = 2
"""So often a doubtful map is made again."""


def make_map(
    out: Path,
    source: Source,
    frames: Mapping[str, Any],
    sightings: list[MarkerSighting],
    config: ReconstructorConfig,
    folder: Path,
) -> Mapping[str, Any]:
    """Poses and points in arbitrary units, judged.

    Raises:
        SceneError: If the map must not be used; the message has advice.
    """
    database = out / MATCHES / DATABASE_FILE
    few_matches = False
    sizes: tuple[int, ...]
    if source.kind == "capture":
        asked = len(frames["names"])
        model = _given_map(database, out / FRAMES, folder, frames, config.poses)
        sizes, name = colmap.piece_sizes([model]), str(model.relative_to(folder))
    elif source.kind == "colmap":
        found = colmap.find_model(source.path)
        assert found is not None
        model, sizes = found, colmap.piece_sizes([found])
        asked = sizes[0]
        name = str(model.resolve())
    else:
        asked = len(frames["names"])
        models, few_matches = _maps(database, out / FRAMES, folder, config.poses, count=asked, tags=bool(sightings))
        if not models:
            nothing = replace(_NOTHING, images=asked)
            raise SceneError(str(refusal(nothing)))
        models = _join_models(models, database, out / FRAMES, sightings, config)
        model, sizes, name = models[0], colmap.piece_sizes(models), str(models[0].relative_to(folder))
    images = colmap.read_map(model)
    # Views of 360-degree images are in the order of their directions.
    sequential = in_order(source.kind, asked, config) and "rig" not in frames
    verdict = judge(images, asked=asked, components=sizes, sequential=sequential)
    reason = refusal(verdict)
    doubtful = few_matches or verdict.points_per_image < DOUBTFUL_POINTS
    if not reason and source.kind in ("video", "photos") and not sightings and doubtful:
        reason = _contradiction(
            images, database, out / FRAMES, folder, config.poses, count=asked, few_matches=few_matches
        )
    if reason:
        raise SceneError(reason)
    return {"model": name, "verdict": {**asdict(verdict), "components": list(sizes)}}


def _given_map(database: Path, photos: Path, folder: Path, frames: Mapping[str, Any], config: PosesConfig) -> Path:
    """The map of images that came with poses.

    Raises:
        SceneError: If they share nothing.
    """
    poses = {name: np.array(pose) for name, pose in frames["pose"].items()}
    adjust = config.given == "adjust" or (config.given == "auto" and bool(frames["rough"]))
    model = apart(colmap.given_model, database, photos, folder / "given", poses, config, adjust=adjust)
    if model is None:
        raise SceneError(str(refusal(replace(_NOTHING, images=len(poses)))))
    return model


def _maps(
    database: Path, photos: Path, folder: Path, config: PosesConfig, *, count: int, tags: bool
) -> tuple[list[Path], bool]:
    """The maps, the largest first, and whether they are a second attempt.

    Where too few images have a pose, a second attempt takes those with fewer matches too. These can be chance, so what
    comes of it must come out the same with other seeds.
    """
    models = colmap.build_maps(database, photos, folder, config, count=count, few_matches=tags)
    enough = sum(colmap.piece_sizes(models[:1])) >= REGISTERED_MIN * count
    if enough or tags or config.mapper_of(count) == "global":
        return models, False
    again = folder / "few_matches"
    again.mkdir()
    return colmap.build_maps(database, photos, again, config, count=count, few_matches=True) or models, True


def _contradiction(
    images: PosedImages,
    database: Path,
    photos: Path,
    folder: Path,
    config: PosesConfig,
    *,
    count: int,
    few_matches: bool,
) -> str | None:
    """Why a map must not be used that comes out differently with other seeds."""
    for number in range(1, REPEATS + 1):
        with TemporaryDirectory(dir=folder) as other:
            again = replace(config, seed=config.seed + number)
            models = colmap.build_maps(database, photos, Path(other), again, count=count, few_matches=few_matches)
            reason = disagreement(images, colmap.read_map(models[0]) if models else None)
        if reason:
            return f"The images share too little to tell how they lie: {reason}. {ADVICE}"
    return None


def _join_models(
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
    poses = dict(zip(whole.names, whole.T_world_camera, strict=True))
    squared, focal = adjusted_by_squares(whole, poses, sightings, fixed_lens=config.poses.fixes_lens)
    folder = models[0].parent / "squared"
    made = apart(colmap.posed_model, database, images, folder, models[0], squared, config.poses, focal=focal)
    return [made, *models]


def _hangs_by_markers(images: PosedImages, sightings: list[MarkerSighting]) -> bool:
    """Whether every image shows a marker, and few points besides."""
    per_image = np.bincount(images.seen[:, 0], minlength=len(images.names))
    return set(images.names) <= {each.image for each in sightings} and float(np.median(per_image)) < DOUBTFUL_POINTS
