"""Lenses that are known before the poses: what a user gives, or a file of a calibration or a capture says.

Pixels have their centres at +0.5 here. OpenCV and ROS put them at whole numbers; that is converted where their files
are read.

Source: the files that `cv2.FileStorage` writes in OpenCV's calibration sample; ROS, camera_calibration_parsers.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from readygo.common.camera.captured import load_views
from readygo.common.documents import YAML_BYTES_MAX, read_json, read_yaml
from readygo.common.errors import ConfigError, SceneError
from readygo.common.files import read_regular
from readygo.services.reconstructor.frames.video import is_same_shape

_MATRIX = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "intrinsic_matrix", "K")
_DISTORTION = ("distortion_coefficients", "distCoeffs", "Distortion_Coefficients", "dist_coeffs", "D")
_WIDTH = ("image_width", "image_Width", "width", "w", "width_px")
_HEIGHT = ("image_height", "image_Height", "height", "h", "height_px")
_COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
"""Of Brown and Conrady, in the order of OpenCV and of COLMAP's models."""
_FISHEYE = ("k1", "k2", "k3", "k4")
_OFF_MIDDLE = 0.25
"""A principal point farther from the middle than this share of the image is of another image."""
_CENTRE_PX = 0.5
_HOW = 'give a file, or numbers as in --intrinsics "fx fy cx cy" or "fx fy cx cy k1 k2 p1 p2"'


@dataclass(frozen=True, kw_only=True)
class Intrinsics:
    """A lens by one of COLMAP's camera models."""

    model: str
    """PINHOLE, OPENCV, FULL_OPENCV or OPENCV_FISHEYE."""
    params: tuple[float, ...]
    """fx, fy, cx, cy [px], pixel centres at +0.5, and the coefficients, in COLMAP's order."""
    size_px: tuple[int, int] | None = None
    """Width and height of the images that they are for; None if that is not known."""

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, self.params)):
            raise ValueError("numbers must be finite")
        if not (self.params[0] > 0.0 and self.params[1] > 0.0):
            raise ValueError("focal lengths must be positive")

    def resize(self, source_px: tuple[int, int], size_px: tuple[int, int]) -> "Intrinsics":
        """The lens for images that were made smaller or larger, from `source_px` to `size_px` (width and height)."""
        across, down = size_px[0] / source_px[0], size_px[1] / source_px[1]
        fx, fy, cx, cy, *rest = self.params
        params = (fx * across, fy * down, cx * across, cy * down, *rest)
        return Intrinsics(model=self.model, params=params, size_px=size_px)

    def turn(self, turned_deg: int) -> "Intrinsics":
        """The lens for images that were turned clockwise by a multiple of 90 deg; its own size must be known.

        A quarter turn takes (x, y) to (-y, x): by the equations of Brown and Conrady k1 to k6 stay, p1 and p2 become p2
        and -p1.
        """
        turned = self
        for _ in range(turned_deg // 90 % 4):
            assert turned.size_px is not None
            (width, height), (fx, fy, cx, cy, *rest) = turned.size_px, turned.params
            if self.model in ("OPENCV", "FULL_OPENCV"):
                rest[2:4] = rest[3], -rest[2]
            turned = replace(turned, params=(fy, fx, height - cy, cx, *rest), size_px=(height, width))
        return turned


def lens(fx: float, fy: float, cx: float, cy: float, coefficients: Sequence[float] = (), **more: Any) -> Intrinsics:
    """A lens with OpenCV's coefficients k1, k2, p1, p2[, k3[, k4, k5, k6]], as the smallest of COLMAP's models.

    Raises:
        ValueError: If there are more coefficients, or numbers are impossible.
    """
    if any(coefficients[len(_COEFFICIENTS) :]):
        raise ValueError(f"at most {len(_COEFFICIENTS)} coefficients of distortion are known")
    padded = [*coefficients, *(0.0 for _ in _COEFFICIENTS)][: len(_COEFFICIENTS)]
    small = not any(padded[4:])
    params = (fx, fy, cx, cy, *(padded[:4] if small else padded))
    return Intrinsics(model="OPENCV" if small else "FULL_OPENCV", params=tuple(map(float, params)), **more)


def fisheye_lens(
    fx: float, fy: float, cx: float, cy: float, coefficients: Sequence[float] = (), **more: Any
) -> Intrinsics:
    """A lens with the coefficients k1 to k4 of OpenCV's fisheye model.

    Raises:
        ValueError: If there are more coefficients, or numbers are impossible.
    """
    if any(coefficients[len(_FISHEYE) :]):
        raise ValueError(f"a fisheye has {len(_FISHEYE)} coefficients of distortion")
    padded = [*coefficients, *(0.0 for _ in _FISHEYE)][: len(_FISHEYE)]
    return Intrinsics(model="OPENCV_FISHEYE", params=tuple(map(float, (fx, fy, cx, cy, *padded))), **more)


def lens_of_row(row: Mapping[str, Any], *, size_px: tuple[int, int] | None = None) -> Intrinsics:
    """The lens of a table with fx, fy, cx, cy (or fl_x, fl_y), coefficients by name, and perhaps width and height.

    Args:
        row: The table.
        size_px: Width and height where the table has none.

    Raises:
        KeyError: If something is missing.
        ValueError: If numbers are impossible.
        TypeError: If a value is none.
    """
    width, height = _first(row, _WIDTH), _first(row, _HEIGHT)
    size = (int(float(width)), int(float(height))) if width is not None and height is not None else size_px
    fx, fy = (float(row[name] if name in row else row[other]) for name, other in (("fx", "fl_x"), ("fy", "fl_y")))
    cx, cy = (
        float(row[name]) if name in row or size is None else 0.5 * side
        for name, side in zip(("cx", "cy"), size or (0, 0), strict=True)
    )
    model = str(row.get("camera_model") or row.get("model") or "").upper()
    # instant-ngp names no model.
    if "FISHEYE" in model or (not model and row.get("is_fisheye")):
        return fisheye_lens(fx, fy, cx, cy, [float(row.get(name, 0.0)) for name in _FISHEYE], size_px=size)
    return lens(fx, fy, cx, cy, [float(row.get(name, 0.0)) for name in _COEFFICIENTS], size_px=size)


def read_intrinsics(text: str) -> Intrinsics:
    """The lens that a user gives.

    Args:
        text: Path of a calibration (.yml, .yaml or .xml of OpenCV, .yaml of ROS), of a .json (a `cameras.json`, the
            truth of a capture, or a table with fx, fy, cx, cy, k1 ...), of a .txt with the matrix of OpenCV, or
            numbers: fx fy cx cy [k1 k2 p1 p2 [k3]] in pixels of the upright images, pixel centres at +0.5.

    Raises:
        ConfigError: If it is none of these.
    """
    path = Path(text)
    read = _READERS.get(path.suffix.lower(), _of_calibration if path.is_file() else None)
    if read is not None:
        try:
            return read(path)
        except (OSError, SceneError, KeyError, TypeError, ValueError, OverflowError) as error:
            reason = getattr(error, "strerror", None) or (f"no {error}" if isinstance(error, KeyError) else error)
            raise ConfigError(f"{path} cannot be read as intrinsics: {reason}; {_HOW}.") from error
    words = text.replace(",", " ").split()
    try:
        numbers = [float(word) for word in words]
        if len(numbers) not in (4, 8, 9):
            raise ValueError(f"{len(numbers)} numbers")
        fx, fy, cx, cy, *coefficients = numbers
        return lens(fx, fy, cx, cy, coefficients)
    except ValueError as error:
        raise ConfigError(f"{text!r} is no file and no intrinsics ({error}); {_HOW}.") from error


def fit_to_images(
    given: Intrinsics, source_px: tuple[int, int], size_px: tuple[int, int], *, turned_deg: int = 0
) -> Intrinsics:
    """The lens for the images that are used; one for the sensor's own images is turned as these were.

    Args:
        given: What the user gave.
        source_px: Width and height of the photos or of the video's frames, upright.
        size_px: Width and height that they were made smaller to.
        turned_deg: By how much they were turned clockwise to be upright, as the camera says [deg].

    Raises:
        ConfigError: If it is for images of another shape.
    """
    (width, height), size = source_px, given.size_px
    if turned_deg % 180 and size and not is_same_shape(size, source_px) and is_same_shape(size[::-1], source_px):
        given = given.turn(turned_deg)
        size = given.size_px
    if size is not None and not is_same_shape(size, source_px):
        turned = "; they are turned by 90 deg" if (size[0] > size[1]) != (width > height) else ""
        raise ConfigError(
            f"--intrinsics are for images of {size[0]}x{size[1]} px, these have {width}x{height} px{turned}: calibrate "
            "with upright images of this shape, or leave the option out."
        )
    fitted = given.resize(size or source_px, source_px)
    off = [abs(c / side - 0.5) for c, side in zip(fitted.params[2:4], source_px, strict=True)]
    if max(off) > _OFF_MIDDLE:
        raise ConfigError(
            f"--intrinsics have the principal point at {fitted.params[2]:.0f}, {fitted.params[3]:.0f}, which is not "
            f"near the middle of images of {width}x{height} px: give them in pixels of the upright images."
        )
    return fitted.resize(source_px, size_px)


def _first(row: Mapping[str, Any], names: Sequence[str]) -> Any:
    """The value of the first of some names that there is; None without any."""
    return next((row[name] for name in names if name in row), None)


def _of_json(path: Path) -> Intrinsics:
    value = read_json(path)
    if isinstance(value, list):
        views = load_views(path)
        if not len(views) or any((each != each[0]).any() for each in (views.K_px, views.sizes_px)):
            raise ValueError("its cameras have different lenses, one is needed")
        K = views.K_px[0]
        width, height = views.sizes_px[0].tolist()
        return lens(K[0, 0], K[1, 1], K[0, 2], K[1, 2], size_px=(width, height))
    if not isinstance(value, dict):
        raise ValueError("it holds no table")
    inner = value.get("camera")
    return lens_of_row({**value, **inner} if isinstance(inner, dict) else value)


def _of_matrix(path: Path) -> Intrinsics:
    """Nine numbers, the matrix of OpenCV row by row, as `numpy.savetxt` writes it; no distortion."""
    words = read_regular(path, bytes_max=YAML_BYTES_MAX).decode("utf-8", errors="replace").replace(",", " ").split()
    if len(words) != 9:
        raise ValueError(f"it holds {len(words)} numbers, a matrix has 9")
    K = np.array(words, dtype=np.float64).reshape(3, 3)
    return lens(K[0, 0], K[1, 1], K[0, 2] + _CENTRE_PX, K[1, 2] + _CENTRE_PX)


def _of_calibration(path: Path) -> Intrinsics:
    """OpenCV's file, else ROS's."""
    table = _storage(path) or _plain_yaml(path)
    matrix, coefficients = _first(table, _MATRIX), _first(table, _DISTORTION)
    if matrix is None:
        raise ValueError(f"it has none of {', '.join(_MATRIX)}")
    K = np.asarray(matrix, dtype=np.float64).reshape(3, 3)
    D = [] if coefficients is None else np.asarray(coefficients, dtype=np.float64).ravel().tolist()
    width, height = _first(table, _WIDTH), _first(table, _HEIGHT)
    size = (int(float(width)), int(float(height))) if width and height else None
    wide = str(table.get("distortion_model", "")).lower() in ("equidistant", "fisheye")
    wide = wide or str(table.get("fisheye_model", "0")) not in ("0", "0.0")
    make = fisheye_lens if wide else lens
    return make(K[0, 0], K[1, 1], K[0, 2] + _CENTRE_PX, K[1, 2] + _CENTRE_PX, D, size_px=size)


def _storage(path: Path) -> dict[str, Any]:
    """The numbers and matrices on top of a file of `cv2.FileStorage`; empty if it is none."""
    text = read_regular(path, bytes_max=YAML_BYTES_MAX).decode("utf-8", errors="replace")
    if not text.lstrip().startswith(("%YAML", "<?xml", "<opencv_storage")):
        return {}
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        root = storage.root()
        found: dict[str, Any] = {}
        for name in list(root.keys()):
            node = root.getNode(name)
            if node.isMap():
                found[name] = node.mat()
            elif node.isReal() or node.isInt():
                found[name] = node.real()
            elif node.isString():
                found[name] = node.string()
        return {name: value for name, value in found.items() if value is not None}
    except (cv2.error, SystemError) as error:
        raise ValueError("it is no file that OpenCV reads") from error


def _plain_yaml(path: Path) -> dict[str, Any]:
    """ROS's calibration: matrices are tables with `data`, numbers are text."""
    value = read_yaml(path)
    if not isinstance(value, dict):
        raise ValueError("it holds no table")
    return {
        name: [float(number) for number in each["data"]] if isinstance(each, dict) and "data" in each else each
        for name, each in value.items()
    }


_READERS: dict[str, Callable[[Path], Intrinsics]] = {
    ".json": _of_json,
    ".txt": _of_matrix,
    ".xml": _of_calibration,
    ".yaml": _of_calibration,
    ".yml": _of_calibration,
}
