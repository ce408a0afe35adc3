"""Networks of the user, as ONNX files, that find the person's mask and keypoints in an image.

| network | input | output |
|---|---|---|
| keypoints | float32 (1, 3, H, W): the person's box, 1.25 times as large, at the input's aspect ratio | `simcc_x` (1, K, 2 W) and `simcc_y` (1, K, 2 H) as of RTMPose, in this order; or one heatmap (1, K, h, w) as of HRNet, see `decode_heatmaps` |
| mask | float32 (1, 3, H, W): the whole image | (1, 1, h, w): probabilities or logits of the person, or (1, 2, h, w) with the person second |

Both take RGB with the mean and deviation of ImageNet. Sizes come from the file; a mask network that leaves its size open
gets at most `OPEN_SIDE_PX`. Sources: Jiang et al., RTMPose, 2023; Li et al., SimCC, 2022.
"""  # noqa: E501

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from readygo.common.arrays import AnyArray, BoolArray, Float32Array, Float64Array, UInt8Array
from readygo.common.errors import AvatarError, first_line
from readygo.common.policy.onnx_policy import open_session
from readygo.services.reconstructor.avatars.keypoints import SETS

MEAN_RGB = np.array([123.675, 116.28, 103.53], dtype=np.float32)
STD_RGB = np.array([58.395, 57.12, 57.375], dtype=np.float32)
BOX_SCALE = 1.25
"""How much larger than the person's box the part of the image is that a network for keypoints sees."""
OPEN_SIDE_PX, _SIDE_STEP_PX = 512, 32
_SIDE_MAX_PX = 4096


class KeypointNetwork:
    """Finds keypoints of the person in a mask."""

    def __init__(self, path: Path) -> None:
        """Open a network.

        Raises:
            AvatarError: If the file cannot be opened, or takes or gives something else.
        """
        self._path, self._session = path, _open(path)
        self._name, self._height, self._width = _image_input(path, self._session)
        if self._height is None or self._width is None:
            raise AvatarError(f"{path}: the input {self._name} must have a fixed height and width for keypoints.")

    def find(self, image: UInt8Array, mask: BoolArray) -> Float64Array:
        """Pixels (u, v) and confidences of the person's keypoints, shape (K, 3).

        Args:
            image: RGB, shape (H, W, 3).
            mask: Where the person is, shape (H, W).
        """
        assert self._height is not None
        assert self._width is not None
        box_px = box_of_mask(mask, self._width / self._height)
        crop = crop_box(image, box_px, (self._width, self._height))
        outputs = _run(self._path, self._session, self._name, crop)
        found = self._decode(outputs)
        left, top, width, _ = box_px
        found[:, :2] = found[:, :2] * (width / self._width) + (left, top)
        return found

    def _decode(self, outputs: list[AnyArray]) -> Float64Array:
        """Pixels in the input (pixel centres at +0.5) and confidences."""
        shapes = [tuple(output.shape) for output in outputs]
        if len(outputs) == 2 and all(len(shape) == 3 and shape[:2] == shapes[0][:2] for shape in shapes):
            found = decode_simcc(outputs[0][0], outputs[1][0], self._width or 1, self._height or 1)
        elif len(outputs) == 1 and len(shapes[0]) == 4:
            found = decode_heatmaps(outputs[0][0], self._width or 1, self._height or 1)
        else:
            raise AvatarError(
                f"{self._path} gives outputs of shapes {shapes}; it must give simcc_x (1, K, bins) and simcc_y, or one "
                "heatmap (1, K, h, w)."
            )
        if len(found) not in SETS:
            counts = " or ".join(str(count) for count in SETS)
            raise AvatarError(f"{self._path} gives {len(found)} keypoints; {counts} are read (COCO, Halpe with feet).")
        return found


class MaskNetwork:
    """Finds where a person is."""

    def __init__(self, path: Path) -> None:
        """Open a network.

        Raises:
            AvatarError: If the file cannot be opened, or takes something else.
        """
        self._path, self._session = path, _open(path)
        self._name, self._height, self._width = _image_input(path, self._session)

    def find(self, image: UInt8Array) -> BoolArray:
        """Where the person is in an image (H, W, 3), shape (H, W)."""
        height, width = image.shape[:2]
        shrink = min(1.0, OPEN_SIDE_PX / max(height, width))
        size = self._width or _open_side(width * shrink), self._height or _open_side(height * shrink)
        small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
        (output, *_) = _run(self._path, self._session, self._name, small)
        if output.ndim == 3:
            output = output[:, None]
        if output.ndim != 4 or output.shape[1] not in (1, 2):
            raise AvatarError(
                f"{self._path} gives {tuple(output.shape)}; a mask must be (1, 1, h, w), or (1, 2, h, w) with the "
                "person second."
            )
        plane = person_share(output[0].astype(np.float32))
        return np.asarray(cv2.resize(plane, (width, height), interpolation=cv2.INTER_LINEAR) > 0.5)


def box_of_mask(mask: BoolArray, aspect: float) -> tuple[float, float, float, float]:
    """Left, top, width and height of a box around the person, `BOX_SCALE` times as large, of an aspect ratio [px]."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    top, bottom = float(rows[0]), float(rows[-1] + 1)
    left, right = float(columns[0]), float(columns[-1] + 1)
    height = BOX_SCALE * max(bottom - top, (right - left) / aspect)
    width = aspect * height
    return 0.5 * (left + right - width), 0.5 * (top + bottom - height), width, height


def crop_box(image: UInt8Array, box_px: tuple[float, float, float, float], size_px: tuple[int, int]) -> UInt8Array:
    """A box of an image at some width and height; black beyond the image, shape (H, W, 3)."""
    left, top, width, _ = box_px
    scale = size_px[0] / width
    # OpenCV's pixel centres are integers: x' + 0.5 = scale (x + 0.5 - left).
    shift = [scale * (0.5 - left) - 0.5, scale * (0.5 - top) - 0.5]
    M = np.array([[scale, 0.0, shift[0]], [0.0, scale, shift[1]]])
    return np.asarray(cv2.warpAffine(image, M, size_px, flags=cv2.INTER_LINEAR), dtype=np.uint8)


def decode_simcc(x: AnyArray, y: AnyArray, width_px: int, height_px: int) -> Float64Array:
    """Pixels in the input and confidences of coordinates that are classes, shape (K, 3).

    Args:
        x: Scores of the bins along the width, shape (K, B).
        y: Scores along the height, shape (K, C).
        width_px: Width of the input.
        height_px: Its height.
    """
    scores = np.minimum(x.max(axis=1), y.max(axis=1)).astype(np.float64)
    u = x.argmax(axis=1) * (width_px / x.shape[1])
    v = y.argmax(axis=1) * (height_px / y.shape[1])
    return np.stack([u + 0.5, v + 0.5, np.maximum(scores, 0.0)], axis=1)


def decode_heatmaps(maps: AnyArray, width_px: int, height_px: int) -> Float64Array:
    """Pixels in the input and confidences of the peaks of heatmaps (K, h, w), shape (K, 3).

    A cell stands for the pixel that its index times the stride counts to, from the first pixel's centre, as HRNet,
    SimpleBaseline and mmpose's MSRAHeatmap are trained. A quarter of a cell is added towards the larger neighbour,
    where there are two.

    Sources: Newell et al., Stacked hourglass networks for human pose estimation, 2016, section 4.1; Xiao et al., Simple
    baselines for human pose estimation and tracking, 2018.
    """
    count, height, width = maps.shape
    padded = np.pad(maps.astype(np.float64), ((0, 0), (1, 1), (1, 1)), mode="reflect")
    row, column = np.divmod(maps.reshape(count, -1).argmax(axis=1), width)
    k = np.arange(count)
    right = np.sign(padded[k, row + 1, column + 2] - padded[k, row + 1, column])
    below = np.sign(padded[k, row + 2, column + 1] - padded[k, row, column + 1])
    u = (column + 0.25 * right) * (width_px / width) + 0.5
    v = (row + 0.25 * below) * (height_px / height) + 0.5
    peaks = np.maximum(maps.reshape(count, -1).max(axis=1), 0.0)
    return np.stack([u, v, peaks], axis=1)


def person_share(output: Float32Array) -> Float32Array:
    """Probability of the person of each pixel, shape (h, w), of an output (1, h, w) or (2, h, w)."""
    if len(output) == 2:
        return np.asarray(1.0 / (1.0 + np.exp(np.clip(output[0] - output[1], -50.0, 50.0))), dtype=np.float32)
    plane = np.asarray(output[0], dtype=np.float32)
    if plane.min() >= 0.0 and plane.max() <= 1.0:
        return plane
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(plane, -50.0, 50.0))), dtype=np.float32)


def _open(path: Path) -> Any:
    return open_session(path, what="Network", remedy="give an ONNX file", raises=AvatarError)


def _image_input(path: Path, session: Any) -> tuple[str, int | None, int | None]:
    """Name, height and width of the only input; None where it leaves a side open."""
    inputs = session.get_inputs()
    if len(inputs) != 1 or inputs[0].type != "tensor(float)" or len(inputs[0].shape) != 4 or inputs[0].shape[1] != 3:
        found = ", ".join(f"{item.name} {item.type} {item.shape}" for item in inputs)
        raise AvatarError(f"{path} must take one image as float32 (1, 3, H, W), it takes {found}.")
    sides = [side if isinstance(side, int) and side > 0 else None for side in inputs[0].shape[2:]]
    if max(side or 0 for side in sides) > _SIDE_MAX_PX:
        raise AvatarError(f"{path} takes images of {sides[1]}x{sides[0]} px, at most {_SIDE_MAX_PX} are allowed.")
    return inputs[0].name, sides[0], sides[1]


def _run(path: Path, session: Any, name: str, image: UInt8Array) -> list[AnyArray]:
    values = (image.astype(np.float32) - MEAN_RGB) / STD_RGB
    try:
        outputs: list[AnyArray] = session.run(None, {name: np.ascontiguousarray(values.transpose(2, 0, 1))[None]})
    except Exception as error:  # onnxruntime raises many unrelated types
        raise AvatarError(f"{path} cannot be run: {first_line(error)}.") from error
    if not all(isinstance(output, np.ndarray) and output.dtype.kind in "biuf" and output.size for output in outputs):
        raise AvatarError(f"{path} must give arrays of numbers, none of them empty.")
    if not all(np.isfinite(output).all() for output in outputs):
        raise AvatarError(f"{path} gives numbers that are not finite.")
    return outputs


def _open_side(side_px: float) -> int:
    return max(_SIDE_STEP_PX, _SIDE_STEP_PX * round(side_px / _SIDE_STEP_PX))
