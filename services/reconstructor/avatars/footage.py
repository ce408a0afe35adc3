"""The film of a person: images, masks, cameras and body poses, in NeuMan's layout or in a plain one.

NeuMan's layout (Jiang et al., NeuMan, 2022, with the poses of HUGS, 2024):

    images/NAME.png
    segmentations/NAME.png or masks/NAME.png     the person is white
    sparse/                                      COLMAP model: a camera and an image for each frame
    4d_humans/smpl_optimized_aligned_scale.npz   global_orient (F, 3), body_pose (F, 69), transl (F, 3), scale (F,),
                                                 betas (F, 10)

A vertex v of the posed SMPL body lies at scale * v + transl in the model's world, in the order of the images' names.

The plain layout has metres and a world whose z points up:

    images/NAME.png, masks/NAME.png
    cameras.json                                 a list of cameras as of 3DGS: img_name, width, height, fx, fy, cx, cy,
                                                 position, rotation
    poses.npz                                    root_m (F, 3): the pelvis; pose_axis_angle (F, 24, 3), as in `Motion`

Without poses.npz, poses are found from keypoints.npz (see `keypoints`); the floor is then z = 0.

Both layouts have pixel centres at +0.5.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from readygo.common.array_files import as_float64, load_npz
from readygo.common.arrays import AnyArray, Float64Array, Int64Array
from readygo.common.camera.captured import CapturedViews, load_views, views_text
from readygo.common.camera.written import colmap_texts
from readygo.common.errors import AvatarError, ReadygoError
from readygo.common.files import write_whole
from readygo.common.frames import (
    yup_from_zup,
    zup_from_yup,
)
from readygo.services.reconstructor.frames.masks import mask_of
from readygo.services.reconstructor.frames.names import times_of_names

IMAGES, SPARSE, CAMERAS_FILE, POSES_FILE = "images", "sparse", "cameras.json", "poses.npz"
MASKS = ("segmentations", "masks")
SMPL_FILE = Path("4d_humans", "smpl_optimized_aligned_scale.npz")
FRAMES_MIN, FRAMES_MAX = 8, 600
SMPL_PELVIS_M = np.array([0.0, -0.22, 0.03])
"""The pelvis of a body of mean shape in SMPL's own frame, whose origin is in the chest [m]; rounded."""
_BYTES_MAX = 2**26
_PLAUSIBLE_M = 100.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Footage:
    """F frames of one person. The world is metric as far as the poses are; its z need not point up."""

    names: tuple[str, ...]
    """Names of the images."""
    images: tuple[Path, ...]
    masks: tuple[Path, ...]
    sizes_px: Int64Array
    """Width and height, shape (F, 2)."""
    K_px: Float64Array
    """Intrinsics, shape (F, 3, 3)."""
    T_world_camera: Float64Array
    """Camera poses [m], OpenCV axes, shape (F, 4, 4)."""
    root_m: Float64Array
    """The pelvis in the world [m], shape (F, 3)."""
    pose_axis_angle: Float64Array
    """Rotations of the joints [rad] as in `Motion`, shape (F, 24, 3)."""
    betas: Float64Array | None = None
    """Coefficients of SMPL's shape, shape (B,), where the poses came with SMPL's translations; None in plain footage.
    The pelvis then is that of a body of mean shape."""

    def __len__(self) -> int:
        return len(self.names)

    @property
    def times(self) -> Float64Array:
        """When the frames were taken, by their names, in usual spacings, shape (F,)."""
        return times_of_names(self.names)


def read_footage(folder: Path, *, masks: Path | None = None, poses: Path | None = None) -> Footage:
    """Read a film of a person in one of the two layouts.

    Args:
        folder: The film.
        masks: Folder of the masks, if they are not in the film.
        poses: File of the poses as in the plain layout, if they are not in the film.

    Raises:
        AvatarError: If a part is missing, or does not fit the others.
    """
    _require_folder(folder)
    if poses is not None:
        return _read_plain(folder, masks, poses)
    given = poses_file(folder)
    if given is None:
        raise AvatarError(
            f"{folder} has no poses: neither {SMPL_FILE} (NeuMan's layout) nor, with {CAMERAS_FILE}, {POSES_FILE} nor "
            "keypoints.npz; `readygo avatar capture` writes an example."
        )
    return _read_neuman(folder, masks) if given == folder / SMPL_FILE else _read_plain(folder, masks, given)


def poses_file(folder: Path) -> Path | None:
    """The file of the poses of a film; None if it has none."""
    return next((folder / name for name in (SMPL_FILE, Path(POSES_FILE)) if (folder / name).is_file()), None)


def masks_folder(folder: Path) -> Path | None:
    """The folder of the masks of a film; None if it has none."""
    return next((folder / name for name in MASKS if (folder / name).is_dir()), None)


def read_views(folder: Path) -> CapturedViews:
    """The cameras of a film in the plain layout, in the order of the images' names.

    Raises:
        AvatarError: If they are missing, cannot be read, or are those of too few or too many images, or of one twice.
    """
    _require_folder(folder)
    if not (folder / CAMERAS_FILE).is_file():
        raise AvatarError(f"{folder} has no {CAMERAS_FILE}; it needs a camera for each image.")
    try:
        views = load_views(folder / CAMERAS_FILE)
    except ReadygoError as error:
        raise AvatarError(str(error).split("; ")[0] + ".") from error
    _check_count(folder, len(views))
    return _by_name(views, folder / CAMERAS_FILE)


def image_files(folder: Path, names: Sequence[str]) -> tuple[Path, ...]:
    """The files of some images of a film.

    Raises:
        AvatarError: If one is missing.
    """
    images = tuple(folder / IMAGES / name for name in names)
    _refuse_missing(folder / IMAGES, [path.name for path in images if not path.is_file()], len(images))
    return images


def mask_files(folder: Path, names: Sequence[str]) -> tuple[Path, ...]:
    """The masks of some images.

    Args:
        folder: Folder of the masks.
        names: Names of the images.

    Raises:
        AvatarError: If one is missing.
    """
    found = {name: mask_of(folder, [name]) for name in names}
    _refuse_missing(folder, [f"{Path(name).stem}.png" for name, mask in found.items() if mask is None], len(names))
    return tuple(mask for mask in found.values() if mask is not None)


def write_neuman(folder: Path, footage: Footage) -> None:
    """Write cameras and poses in NeuMan's layout; images and masks lie there already.

    The model's world is the y-up world of SMPL, in metres. The shape (betas) is that of the mean body.

    Raises:
        AvatarError: If a file cannot be written.
    """
    sparse = folder / SPARSE
    sparse.mkdir(parents=True, exist_ok=True)
    T = footage.T_world_camera.copy()
    T[:, :3] = yup_from_zup(T[:, :3].swapaxes(1, 2)).swapaxes(1, 2)
    texts = colmap_texts(replace(_views(footage), T_world_camera=T), np.empty((0, 3)), np.empty((0, 3), np.uint8))
    for name, text in texts.items():
        write_whole(sparse / name, text, raises=AvatarError)
    path = folder / SMPL_FILE
    path.parent.mkdir(exist_ok=True)
    pose = footage.pose_axis_angle.astype(np.float32)
    np.savez(
        path,
        allow_pickle=False,
        global_orient=pose[:, 0],
        body_pose=pose[:, 1:].reshape(len(pose), 69),
        transl=(yup_from_zup(footage.root_m) - SMPL_PELVIS_M).astype(np.float32),
        scale=np.ones(len(pose), dtype=np.float32),
        betas=np.zeros((len(pose), 10), dtype=np.float32),
    )


def write_plain(folder: Path, footage: Footage) -> None:
    """Write cameras and poses in the plain layout; images and masks lie there already.

    Raises:
        AvatarError: If a file cannot be written.
    """
    write_views(folder, footage)
    write_poses(folder / POSES_FILE, footage.root_m, footage.pose_axis_angle)


def write_views(folder: Path, footage: Footage) -> None:
    """Write the cameras in the plain layout.

    Raises:
        AvatarError: If the file cannot be written.
    """
    write_whole(folder / CAMERAS_FILE, views_text(_views(footage)), raises=AvatarError)


def write_poses(path: Path, root_m: Float64Array, pose_axis_angle: Float64Array) -> None:
    """Write poses in the plain layout.

    Args:
        path: The file.
        root_m: Pelvises [m], shape (F, 3).
        pose_axis_angle: Rotations of the joints [rad], shape (F, 24, 3).
    """
    np.savez(
        path,
        allow_pickle=False,
        root_m=root_m.astype(np.float32),
        pose_axis_angle=pose_axis_angle.astype(np.float32),
    )


def _views(footage: Footage) -> CapturedViews:
    return CapturedViews(
        images=footage.names, sizes_px=footage.sizes_px, K_px=footage.K_px, T_world_camera=footage.T_world_camera
    )


def _by_name(views: CapturedViews, source: Path) -> CapturedViews:
    """Cameras in the order of their images' names as text, in which the rows of the poses are.

    Raises:
        AvatarError: If an image has two cameras; `source` is where they are from.
    """
    name, count = Counter(views.images).most_common(1)[0] if len(views) else ("", 0)
    if count > 1:
        raise AvatarError(f"{source} has {count} cameras for the image {name}; leave one of them.")
    return views.select(sorted(range(len(views)), key=lambda number: views.images[number]))


def _read_neuman(folder: Path, masks: Path | None) -> Footage:
    path = folder / SMPL_FILE
    arrays = load_npz(
        path, ("global_orient", "body_pose", "transl", "scale", "betas"), bytes_max=_BYTES_MAX, raises=AvatarError
    )
    missing = [key for key in ("global_orient", "body_pose", "transl") if key not in arrays]
    if missing:
        raise AvatarError(f"{path} lacks {', '.join(missing)}; it needs SMPL's parameters of every frame.")
    body = np.atleast_1d(_numbers(path, arrays, "body_pose"))
    body = body.reshape(len(body), math.prod(body.shape[1:]))
    if body.shape[1] != 69:
        raise AvatarError(
            f"{path}: body_pose has {body.shape[1]} numbers a frame, SMPL has 69 (23 joints); "
            "poses of SMPL-X (63), SMPL-H (63, and hands) or rotation matrices (207) must be converted."
        )
    views = _colmap_views(folder)
    count = len(body)
    orient = _fit_rows(path, arrays, "global_orient", count, 3)
    transl = _fit_rows(path, arrays, "transl", count, 3)
    scales = _numbers(path, arrays, "scale").reshape(-1) if "scale" in arrays else np.ones(1)
    scale = float(np.median(scales)) if len(scales) else 0.0
    if not (np.isfinite(scale) and scale > 0.0):
        raise AvatarError(f"{path}: scale must be positive, got {scale}.")
    # What the model calls the y-up world need not stand upright: nothing here depends on it.
    T = views.T_world_camera.copy()
    T[:, :3, :3] = zup_from_yup(T[:, :3, :3].swapaxes(1, 2)).swapaxes(1, 2)
    T[:, :3, 3] = zup_from_yup(T[:, :3, 3] / scale)
    footage = _footage(
        folder,
        views,
        T,
        zup_from_yup(transl / scale + SMPL_PELVIS_M),
        np.concatenate([orient, body], axis=1).reshape(count, 24, 3),
        path,
        masks,
    )
    return replace(footage, betas=_shape_of(path, arrays))


def _shape_of(path: Path, arrays: Mapping[str, AnyArray]) -> Float64Array:
    """Coefficients of SMPL's shape, shape (B,): one person has one shape, files hold it once or for each frame."""
    rows = np.atleast_2d(_numbers(path, arrays, "betas")) if "betas" in arrays else np.zeros((0, 0))
    if not np.isfinite(rows).all():
        raise AvatarError(f"{path}: betas hold values that are not finite.")
    return np.median(rows.reshape(len(rows), math.prod(rows.shape[1:])), axis=0) if rows.size else np.zeros(0)


def _read_plain(folder: Path, masks: Path | None, path: Path) -> Footage:
    arrays = load_npz(path, ("root_m", "pose_axis_angle"), bytes_max=_BYTES_MAX, raises=AvatarError)
    if set(arrays) != {"root_m", "pose_axis_angle"}:
        raise AvatarError(f"{path} needs root_m (F, 3) and pose_axis_angle (F, 24, 3), it has {sorted(arrays)}.")
    pose = _numbers(path, arrays, "pose_axis_angle")
    if pose.shape[1:] != (24, 3):
        raise AvatarError(f"{path}: pose_axis_angle must be (F, 24, 3) for the joints of SMPL, got {pose.shape}.")
    root = _fit_rows(path, arrays, "root_m", len(pose), 3)
    views = read_views(folder)
    return _footage(folder, views, views.T_world_camera, root, pose, path, masks)


def _colmap_views(folder: Path) -> CapturedViews:
    """The cameras of a text or binary COLMAP model."""
    from readygo.services.reconstructor.poses import colmap

    model = colmap.find_model(folder)
    if model is None:
        raise AvatarError(f"{folder} has no COLMAP model in {SPARSE}/ with a camera and a pose for each image.")
    try:
        if not colmap.is_pinhole(model):
            raise AvatarError(f"{model} has cameras with distortion; undistort the images with `colmap` first.")
        return _by_name(colmap.pinhole_views(model), model)
    except AvatarError:
        raise
    except ReadygoError as error:
        raise AvatarError(f"{model} cannot be read: {error}") from error


def _numbers(path: Path, arrays: Mapping[str, AnyArray], key: str) -> Float64Array:
    return as_float64(arrays[key], f"{path}: {key}", raises=AvatarError)


def _fit_rows(path: Path, arrays: Mapping[str, AnyArray], key: str, count: int, width: int) -> Float64Array:
    array = _numbers(path, arrays, key)
    if array.shape != (count, width):
        raise AvatarError(f"{path}: {key} must have shape ({count}, {width}), a row for each frame, got {array.shape}.")
    return array


def _footage(
    folder: Path,
    views: CapturedViews,
    T: Float64Array,
    root_m: Float64Array,
    pose: Float64Array,
    poses_path: Path,
    masks: Path | None,
) -> Footage:
    """Check that the parts fit each other, and find the files of the images."""
    count = len(views)
    if count != len(pose):
        raise AvatarError(f"{poses_path} has poses of {len(pose)} frames, but {count} images have a camera.")
    _check_count(folder, count)
    for name, array in (("translations", root_m), ("rotations", pose), ("cameras", T)):
        if not np.isfinite(array).all() or np.abs(array).max() > _PLAUSIBLE_M:
            raise AvatarError(f"{poses_path}: {name} hold values that are not finite, or far beyond a room.")
    masks = masks or masks_folder(folder)
    if masks is None:
        raise AvatarError(f"{folder} has no masks: neither {MASKS[0]}/ nor {MASKS[1]}/.")
    return Footage(
        names=views.images,
        images=image_files(folder, views.images),
        masks=mask_files(masks, views.images),
        sizes_px=views.sizes_px,
        K_px=views.K_px,
        T_world_camera=T,
        root_m=root_m,
        pose_axis_angle=pose,
    )


def _require_folder(folder: Path) -> None:
    if not folder.is_dir():
        raise AvatarError(f"{folder} is not a folder; give one with images, masks, cameras and poses, or a video.")


def _check_count(folder: Path, count: int) -> None:
    if not FRAMES_MIN <= count <= FRAMES_MAX:
        raise AvatarError(f"{folder} has {count} frames; an avatar needs {FRAMES_MIN} to {FRAMES_MAX}.")


def _refuse_missing(folder: Path, missing: list[str], count: int) -> None:
    if missing:
        raise AvatarError(f"{folder} lacks {len(missing)} of {count} files, {missing[0]} among them.")
