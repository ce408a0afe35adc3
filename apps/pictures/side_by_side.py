"""Images of a robot's cameras at one time as one picture: cameras from left to right, depths below colours."""

from collections.abc import Iterable, Mapping, Sequence

import cv2
import numpy as np

from readygo.apps.pictures.shades import shade_depth
from readygo.common.arrays import AnyArray, UInt8Array
from readygo.common.dataset import Dataset
from readygo.common.drawing import plan_view
from readygo.common.drawing.plan_view import INK, WHITE
from readygo.common.errors import DatasetError
from readygo.common.images.names import RGB, SHOWN_KINDS, camera_of, cameras_of, image_name, kind_of
from readygo.common.robot import RobotConfig

GAP_PX, CAPTION_PX = 4, 20
CAMERAS_WIDTH_PX = 1200
"""Approximate width of the images of several cameras together [px]."""
ALONE = ((RGB,),)
"""Result of `shown_images` for one camera without depth, which is shown at its size and without a caption."""


def shown_images(names: Iterable[str], robot: RobotConfig, camera: str = "") -> tuple[tuple[str, ...], ...]:
    """The layout of existing images: a row for each kind, cameras from left to right.

    Args:
        names: Names of the existing images.
        robot: Robot with the cameras.
        camera: Name of the only camera to show; empty for all.

    Raises:
        DatasetError: If there is no such camera.
    """
    found = tuple(names)
    # Shards of other programs may have cameras that their robot does not name.
    cameras = sorted(cameras_of(found), key=lambda name: -robot.cameras.get(name, robot.camera).mount_yaw_deg)
    if camera:
        called = {camera_name(name, robot): name for name in cameras}
        if camera not in called:
            raise DatasetError(f"There are no images of a camera {camera!r}; there are those of {', '.join(called)}.")
        cameras = [called[camera]]
    rows = ([image_name(name, kind) for name in cameras] for kind in SHOWN_KINDS)
    return tuple(kept for row in rows if (kept := tuple(name for name in row if name in found)))


def has_several(dataset: Dataset) -> bool:
    """True if there are several images to show of one time."""
    return shown_images(dataset.outputs, dataset.robot or RobotConfig()) != ALONE


def camera_name(camera: str, robot: RobotConfig) -> str:
    """Display name of a camera; the first one is "" among the names of images."""
    return camera or robot.camera_name


def caption_of(name: str, robot: RobotConfig) -> str:
    """Caption of an image."""
    camera = camera_name(camera_of(name), robot)
    return camera if kind_of(name) == RGB else f"{camera} {kind_of(name)}"


def recorded_together(
    dataset: Dataset, sample: int, rows: Sequence[Sequence[str]], robot: RobotConfig, *, width_px: int
) -> UInt8Array:
    """The cameras' images of a sample as one picture; arguments as in `side_by_side`.

    Raises:
        DatasetError: If an image is damaged.
    """
    names = [name for row in rows for name in row]
    decoded = {name: dataset.decode_output(sample, name) for name in names}
    return side_by_side(decoded, rows, robot, width_px=width_px)


def side_by_side(
    images: Mapping[str, AnyArray], rows: Sequence[Sequence[str]], robot: RobotConfig, *, width_px: int
) -> UInt8Array:
    """Pictures in rows, all of one height, with names below.

    Args:
        images: Images by name: colours, shape (H, W, 3), or depths [m], shape (H, W), which are shaded.
        rows: Layout from `shown_images`.
        robot: Robot with the cameras.
        width_px: Approximate total width [px]: pictures are enlarged by an integer factor, or reduced.

    Returns:
        sRGB image.
    """
    pictures = {
        name: images[name] if kind_of(name) == RGB else shade_depth(images[name]) for row in rows for name in row
    }
    height_px = max(len(pictures[row[0]]) for row in rows)
    widest_px = max(sum(_width_at(pictures[name], height_px) for name in row) for row in rows)
    scale = max(1, width_px // widest_px) if widest_px <= width_px else width_px / widest_px
    strips = [_strip(row, pictures, robot, round(scale * height_px)) for row in rows]
    whole = np.full((sum(map(len, strips)), max(strip.shape[1] for strip in strips), 3), WHITE, np.uint8)
    top = 0
    for strip in strips:
        whole[top : top + len(strip), : strip.shape[1]] = strip
        top += len(strip)
    return whole


def _strip(names: Sequence[str], images: Mapping[str, UInt8Array], robot: RobotConfig, height_px: int) -> UInt8Array:
    tiles = [_add_caption(images[name], caption_of(name, robot), height_px) for name in names]
    gap = np.full((len(tiles[0]), GAP_PX, 3), WHITE, np.uint8)
    return np.concatenate([part for tile in tiles for part in (tile, gap)][:-1], axis=1)


def _add_caption(picture: UInt8Array, text: str, height_px: int) -> UInt8Array:
    method = cv2.INTER_CUBIC if height_px > len(picture) else cv2.INTER_AREA
    size = (_width_at(picture, height_px), height_px)
    image = np.asarray(cv2.resize(picture, size, interpolation=method), np.uint8)
    caption = np.full((CAPTION_PX, image.shape[1], 3), WHITE, np.uint8)
    plan_view.put_text(caption, text, (2, 15), colour=INK)
    return np.concatenate([image, caption])


def _width_at(picture: UInt8Array, height_px: int) -> int:
    """The width of a picture after scaling to a height [px]."""
    width_px: int = picture.shape[1]
    return round(width_px * height_px / len(picture))
