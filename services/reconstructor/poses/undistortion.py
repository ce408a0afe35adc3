"""Images and masks without lens distortion, and the COLMAP model of their pinhole cameras."""

import shutil
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.errors import RunError, SceneError
from readygo.common.files import write_whole
from readygo.services.reconstructor.frames.depths import FOLDER as DEPTHS
from readygo.services.reconstructor.frames.depths import STEP_M, read_steps, to_steps
from readygo.services.reconstructor.frames.masks import FOLDER as MASKS
from readygo.services.reconstructor.frames.masks import read_mask
from readygo.services.reconstructor.poses.colmap import open_model, pycolmap
from readygo.services.reconstructor.poses.config import PosesConfig
from readygo.services.reconstructor.similarity import Similarity


def write_undistorted(model: Path, images: Path, folder: Path, b_from_a: Similarity, config: PosesConfig) -> None:
    """Write a model in another frame with pinhole images, as COLMAP does: `images/` and `sparse/0/`.

    Args:
        model: The model that `b_from_a` moves.
        images: Folder of its images.
        folder: Where to write.
        b_from_a: From the model's frame to the new one.
        config: How many threads.

    Raises:
        RunError: If images could not be written.
    """
    colmap = pycolmap()
    rec = colmap.Reconstruction(model)
    rec.transform(colmap.Sim3d(b_from_a.scale, colmap.Rotation3d(b_from_a.R), b_from_a.t))
    with tempfile.TemporaryDirectory() as moved:
        rec.write(moved)
        colmap.undistort_images(folder, moved, images, jpeg_quality=97, num_threads=config.threads or -1)
    # COLMAP continues after an image that it could not write.
    written = [folder / "images" / rec.images[number].name for number in rec.reg_image_ids()]
    lost = [path.name for path in written if not path.is_file() or path.stat().st_size == 0]
    if lost:
        raise RunError(f"{len(lost)} undistorted images could not be written, {lost[0]} among them; is the disk full?")
    sparse = folder / "sparse"
    inner = folder / "0"
    sparse.rename(inner)
    sparse.mkdir()
    inner.rename(sparse / "0")
    # For COLMAP's dense stereo, which nothing here uses.
    shutil.rmtree(folder / "stereo", ignore_errors=True)
    for script in folder.glob("run-colmap-*.sh"):
        script.unlink()


def write_undistorted_masks(model: Path, masks: Path, posed: Path) -> None:
    """Write the masks of images as `write_undistorted` made these: `masks/NAME.png`; pixels that no image has are 0.

    Args:
        model: The model before.
        masks: Folder of its images' masks, NAME.png.
        posed: Folder with the undistorted model.

    Raises:
        SceneError: If a mask is missing or has another size than its camera.
    """
    before, after = open_model(model), open_model(posed / "sparse" / "0")
    places: dict[tuple[int, int], tuple[Float64Array, Float64Array]] = {}
    for image in (after.images[number] for number in after.reg_image_ids()):
        lens = before.find_image_with_name(image.name).camera
        key = (lens.camera_id, image.camera_id)
        if key not in places:
            places[key] = _places_before(lens, image.camera)
        mask = read_mask(masks / f"{image.name}.png")
        if mask is None or mask.shape != (lens.height, lens.width):
            there = "missing" if mask is None else f"{mask.shape[1]}x{mask.shape[0]} px"
            raise SceneError(f"{masks / image.name}.png is {there}, its image {lens.width}x{lens.height} px.")
        u, v = (place.astype(np.float32) for place in places[key])
        flat = cv2.remap(mask, u, v, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
        data = cv2.imencode(".png", flat)[1].tobytes()
        write_whole(posed / MASKS / f"{image.name}.png", data, raises=SceneError)


def write_undistorted_depths(model: Path, depths: Path, posed: Path, scale: float) -> None:
    """Write depth images as `write_undistorted` made their images, with about as many pixels as they had.

    Args:
        model: The model before.
        depths: Folder of its images' depth images, NAME.png, see `read_steps`; some may be missing.
        posed: Folder with the undistorted model; gets `depth/NAME.png`.
        scale: By which depths become longer.

    Raises:
        SceneError: If one cannot be written.
    """
    before, after = open_model(model), open_model(posed / "sparse" / "0")
    for image in (after.images[number] for number in after.reg_image_ids()):
        steps = read_steps(depths / f"{image.name}.png")
        if steps is None:
            continue
        lens, pinhole = before.find_image_with_name(image.name).camera, image.camera
        share = max(steps.shape) / max(pinhole.height, pinhole.width)
        shape = (round(pinhole.height * share), round(pinhole.width * share))
        sides = np.array(steps.shape[::-1]) / (lens.width, lens.height)
        u, v = (
            np.floor((place + 0.5) * side).astype(np.int64)
            for place, side in zip(_places_before(lens, pinhole, shape), sides, strict=True)
        )
        inside = (u >= 0) & (v >= 0) & (u < steps.shape[1]) & (v < steps.shape[0])
        flat = np.zeros(shape, dtype=np.uint16)
        flat[inside] = to_steps(steps[v[inside], u[inside]] * (scale * STEP_M))
        write_whole(posed / DEPTHS / f"{image.name}.png", cv2.imencode(".png", flat)[1].tobytes(), raises=SceneError)


def _places_before(lens: Any, pinhole: Any, shape: tuple[int, int] | None = None) -> tuple[Float64Array, Float64Array]:
    """Column and row, counted from the first pixel's centre, that each pixel of a pinhole camera shows of another.

    Args:
        lens: The other camera.
        pinhole: The camera.
        shape: Rows and columns that the pinhole camera's image is made of; None: its own.
    """
    rows, columns = shape or (pinhole.height, pinhole.width)
    v, u = np.mgrid[:rows, :columns] + 0.5
    v, u = v * (pinhole.height / rows), u * (pinhole.width / columns)
    K = pinhole.calibration_matrix()
    rays = np.column_stack([((u - K[0, 2]) / K[0, 0]).ravel(), ((v - K[1, 2]) / K[1, 1]).ravel(), np.ones(u.size)])
    pixels = np.asarray(lens.img_from_cam(rays)).reshape(*u.shape, 2) - 0.5
    # A lens that cannot show a ray shows nothing there.
    pixels = np.where(np.isfinite(pixels), pixels, -2.0)
    return pixels[..., 0], pixels[..., 1]
