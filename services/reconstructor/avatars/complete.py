"""What footage lacks is found: masks and keypoints by networks of the user, poses from keypoints; each once.

| stage | folder | content |
|---|---|---|
| video | `video` | footage in the plain layout, of a video; see `fixed_camera` |
| masks | `masks` | NAME.png of each image |
| keypoints | `keypoints` | keypoints.npz |
| poses | `poses` | poses.npz |
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from readygo.common.avatars import Avatar
from readygo.common.camera.captured import CapturedViews
from readygo.common.config import section_to_mapping
from readygo.common.errors import AvatarError
from readygo.common.files import write_whole
from readygo.services.reconstructor.avatars.config import AvatarFitConfig
from readygo.services.reconstructor.avatars.detectors import KeypointNetwork, MaskNetwork
from readygo.services.reconstructor.avatars.fixed_camera import VIDEO_STAGE, footage_of_video
from readygo.services.reconstructor.avatars.footage import (
    CAMERAS_FILE,
    MASKS,
    POSES_FILE,
    Footage,
    image_files,
    mask_files,
    masks_folder,
    poses_file,
    read_footage,
    read_views,
    write_poses,
)
from readygo.services.reconstructor.avatars.keypoint_poses import fit_poses
from readygo.services.reconstructor.avatars.keypoint_start import KeypointViews
from readygo.services.reconstructor.avatars.keypoints import (
    KEYPOINTS_FILE,
    Keypoints,
    check_keypoints,
    keypoints_of,
    read_keypoints,
    write_keypoints,
)
from readygo.services.reconstructor.avatars.views import PersonMask, read_masks, read_rgb
from readygo.services.reconstructor.frames.names import times_of_names
from readygo.services.reconstructor.stages import Stages, code_digest, identity_of

MASKS_STAGE, KEYPOINTS_STAGE, POSES_STAGE = "masks", "keypoints", "poses"
STAGE_FOLDERS = (VIDEO_STAGE, MASKS_STAGE, KEYPOINTS_STAGE, POSES_STAGE)


@dataclass(frozen=True, kw_only=True)
class PersonNetworks:
    """ONNX files of the user, for what footage lacks."""

    keypoints: Path | None = None
    mask: Path | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class CompleteFootage:
    """Footage with masks and poses, given or found."""

    footage: Footage
    poses_found: bool
    """True where poses come from keypoints."""
    notes: tuple[str, ...]
    """Hints for the user."""


def complete_footage(
    folder: Path, stages: Stages, networks: PersonNetworks, bodies: Mapping[str, Avatar], config: AvatarFitConfig
) -> CompleteFootage:
    """Read footage, and find what it lacks.

    Args:
        folder: Film of a person, see `footage`, or a video from a camera that stands still.
        stages: Where to keep what is found.
        networks: What to find masks and keypoints with.
        bodies: Bodies whose mean proportions a person is expected to have.
        config: How poses are found.

    Raises:
        AvatarError: If something is missing that cannot be found, or does not fit the rest.
    """
    hints: tuple[str, ...] = ()
    if folder.is_file():
        folder, hints = footage_of_video(folder, stages, config.camera)
    given, masks = poses_file(folder), masks_folder(folder)
    hints = (*hints, *_unused_notes(folder, networks))
    if masks is None and networks.mask is not None:
        masks = _find_masks(folder, stages, networks.mask)
    if given is not None or not _can_find_poses(folder, networks):
        return CompleteFootage(footage=read_footage(folder, masks=masks), poses_found=False, notes=hints)
    if masks is None:
        raise AvatarError(f"{folder} has no masks: neither {MASKS[0]}/ nor {MASKS[1]}/; give them, or --mask-model.")
    views = read_views(folder)
    keypoints, notes = _keypoints(folder, masks, views, stages, networks.keypoints)
    found = _find_poses(keypoints, views, stages, bodies, config)
    footage = read_footage(folder, masks=masks, poses=stages.folder / POSES_STAGE / POSES_FILE)
    return CompleteFootage(footage=footage, poses_found=True, notes=(*hints, *notes, *found["notes"]))


def _can_find_poses(folder: Path, networks: PersonNetworks) -> bool:
    return (folder / KEYPOINTS_FILE).is_file() or (networks.keypoints is not None and (folder / CAMERAS_FILE).is_file())


def _unused_notes(folder: Path, networks: PersonNetworks) -> tuple[str, ...]:
    """Hints about networks for what the footage has."""
    notes = []
    if networks.mask is not None and masks_folder(folder) is not None:
        notes.append("the network for masks is not used: the footage has masks.")
    if networks.keypoints is not None and (poses_file(folder) or (folder / KEYPOINTS_FILE).is_file()):
        notes.append("the network for keypoints is not used: the footage has poses or keypoints.")
    return tuple(notes)


def _find_masks(folder: Path, stages: Stages, network: Path) -> Path:
    names = read_views(folder).images
    images = image_files(folder, names)

    def make(stage: Path) -> Mapping[str, Any]:
        finder = MaskNetwork(network)
        for name, path in zip(names, images, strict=True):
            mask = np.where(finder.find(read_rgb(path, "image")), 255, 0).astype(np.uint8)
            encoded = cv2.imencode(".png", mask)[1].tobytes()
            write_whole(stage / f"{name}.png", encoded, raises=AvatarError)
        return {"images": len(images)}

    settings = {"network": _digest_file(network), "images": identity_of([*images])}
    stages.run(MASKS_STAGE, settings, make, code=code_digest("avatars"))
    return stages.folder / MASKS_STAGE


def _keypoints(
    folder: Path, masks: Path, views: CapturedViews, stages: Stages, network: Path | None
) -> tuple[Keypoints, list[str]]:
    """Keypoints, given or found, that fit the masks; hints about what is missing."""
    images, paths = image_files(folder, views.images), mask_files(masks, views.images)
    persons, _ = read_masks(paths, views.sizes_px)
    source = folder / KEYPOINTS_FILE
    if not source.is_file():
        assert network is not None
        _find_keypoints(views.images, images, paths, persons, stages, network)
        source = stages.folder / KEYPOINTS_STAGE / KEYPOINTS_FILE
    keypoints = read_keypoints(source, views.images)
    return keypoints, check_keypoints(keypoints, (each.whole() for each in persons), views.images, source)


def _find_keypoints(
    names: tuple[str, ...],
    images: tuple[Path, ...],
    masks: tuple[Path, ...],
    persons: list[PersonMask],
    stages: Stages,
    network: Path,
) -> None:
    def make(stage: Path) -> Mapping[str, Any]:
        finder = KeypointNetwork(network)
        rows = [finder.find(read_rgb(path, "image"), mask.whole()) for path, mask in zip(images, persons, strict=True)]
        write_keypoints(stage / KEYPOINTS_FILE, keypoints_of(np.stack(rows), network), names)
        return {"images": len(images)}

    settings = {"network": _digest_file(network), "images": identity_of([*images]), "masks": identity_of([*masks])}
    stages.run(KEYPOINTS_STAGE, settings, make, code=code_digest("avatars"))


def _find_poses(
    keypoints: Keypoints, views: CapturedViews, stages: Stages, bodies: Mapping[str, Avatar], config: AvatarFitConfig
) -> dict[str, Any]:
    times = times_of_names(views.images)

    def make(stage: Path) -> Mapping[str, Any]:
        seen = KeypointViews(keypoints=keypoints, K_px=views.K_px, T_world_camera=views.T_world_camera, times=times)
        found = fit_poses(seen, [bodies[name] for name in sorted(bodies)], config)
        write_poses(stage / POSES_FILE, found.root_m, found.pose_axis_angle)
        return {"miss_px": round(found.miss_px, 2), "notes": list(found.notes)}

    digest = hashlib.sha256()
    for name in sorted(bodies):
        digest.update(bodies[name].joints_tpose_m.tobytes())
    for array in (keypoints.uv_px, keypoints.confidence, views.K_px, views.T_world_camera, times):
        digest.update(array.tobytes())
    settings = {
        "input": digest.hexdigest(),
        "keypoints": section_to_mapping(config.keypoints),
        "prior": section_to_mapping(config.prior),
    }
    return stages.run(POSES_STAGE, settings, make, code=code_digest("avatars"))


def _digest_file(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
