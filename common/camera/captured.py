"""The cameras that a scene was filmed with, and the `cameras.json` that 3DGS and its kin write of them."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import Float64Array, Int64Array
from readygo.common.documents import read_json
from readygo.common.errors import SceneError

FILE_BYTES_MAX = 1 << 26
"""Larger files are not read: more than 100,000 cameras."""
AGREE_MIN = 0.3
"""Cameras whose ups have a shorter mean look every way, and tell nothing of up."""
ROTATION_ERROR_MAX = 1e-3
"""Largest error of R R^T of a pose that is read."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CapturedViews:
    """N pinhole cameras in one frame."""

    images: tuple[str, ...]
    """Names of their images."""
    sizes_px: Int64Array
    """Width and height [px], shape (N, 2)."""
    K_px: Float64Array
    """Intrinsics [px], pixel centres at +0.5, shape (N, 3, 3)."""
    T_world_camera: Float64Array
    """Poses; maps camera coordinates (OpenCV axes) to the frame, shape (N, 4, 4)."""

    def __post_init__(self) -> None:
        count = len(self.images)
        shapes = {"sizes_px": (count, 2), "K_px": (count, 3, 3), "T_world_camera": (count, 4, 4)}
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise ValueError(f"{name} must have shape {shape}, got {getattr(self, name).shape}.")

    def __len__(self) -> int:
        return len(self.images)

    def select(self, numbers: Sequence[int]) -> "CapturedViews":
        """Some of the cameras, in this order."""
        rows = list(numbers)
        return CapturedViews(
            images=tuple(self.images[row] for row in rows),
            sizes_px=self.sizes_px[rows],
            K_px=self.K_px[rows],
            T_world_camera=self.T_world_camera[rows],
        )

    @property
    def mean_up(self) -> Float64Array | None:
        """Unit vector, the mean of the cameras' own up directions, shape (3,); None where they look every way."""
        mean: Float64Array = -self.T_world_camera[:, :3, 1].mean(axis=0) if len(self) else np.zeros(3)
        length = float(np.sqrt(mean @ mean))
        return mean / length if length >= AGREE_MIN else None

    def transform(
        self, R: npt.ArrayLike, translate_m: npt.ArrayLike = (0.0, 0.0, 0.0), scale: float = 1.0
    ) -> "CapturedViews":
        """The cameras after x' = scale R x + translate, as `transform_cloud` moves Gaussians."""
        R = np.asarray(R, dtype=np.float64)
        T = self.T_world_camera.copy()
        T[:, :3, :3] = R @ T[:, :3, :3]
        T[:, :3, 3] = scale * T[:, :3, 3] @ R.T + np.asarray(translate_m, dtype=np.float64)
        return CapturedViews(images=self.images, sizes_px=self.sizes_px, K_px=self.K_px, T_world_camera=T)


def load_views(path: str | Path) -> CapturedViews:
    """Read a `cameras.json` of 3DGS, 2DGS, PGSR or of a scene bundle.

    A camera has img_name, width, height, fx, fy, position (its centre) and rotation (camera to world, row by row,
    OpenCV axes); without cx and cy its principal point is the image's middle.

    Raises:
        SceneError: If the file cannot be read, or a camera is incomplete or impossible.

    Source: graphdeco-inria/gaussian-splatting, `camera_to_JSON`.
    """
    path = Path(path)
    try:
        rows = read_json(path, bytes_max=FILE_BYTES_MAX)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SceneError(f"{path} cannot be read: {reason}; without it, the scene has no cameras.") from error
    if not isinstance(rows, list):
        raise SceneError(f"{path} is not a list of cameras; remove it to import the scene without them.")
    try:
        return _views(rows)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        line = f"{type(error).__name__}: {error}"
        raise SceneError(f"{path} holds a broken camera ({line}); remove it to import the scene without.") from error


def _views(rows: list[Any]) -> CapturedViews:
    count = len(rows)
    T, K = np.tile(np.eye(4), (count, 1, 1)), np.tile(np.eye(3), (count, 1, 1))
    sizes = np.empty((count, 2), np.int64)
    for k, row in enumerate(rows):
        sizes[k] = row["width"], row["height"]
        K[k, 0, 0], K[k, 1, 1] = row["fx"], row["fy"]
        K[k, :2, 2] = row.get("cx", 0.5 * sizes[k, 0]), row.get("cy", 0.5 * sizes[k, 1])
        T[k, :3, :3], T[k, :3, 3] = row["rotation"], row["position"]
    R = T[:, :3, :3]
    if not (np.isfinite(T).all() and np.isfinite(K).all() and (sizes > 0).all() and (K[:, [0, 1], [0, 1]] > 0).all()):
        raise ValueError("numbers must be finite, sizes and focal lengths positive")
    if not (np.abs(R @ R.swapaxes(1, 2) - np.eye(3)) < ROTATION_ERROR_MAX).all() or (np.linalg.det(R) < 0).any():
        raise ValueError("rotation is none")
    images = tuple(str(row.get("img_name", k)) for k, row in enumerate(rows))
    return CapturedViews(images=images, sizes_px=sizes, K_px=K, T_world_camera=T)


def views_text(views: CapturedViews) -> str:
    """The text of a `cameras.json` that `load_views` and viewers of 3DGS scenes read."""
    return json.dumps([_row(views, k) for k in range(len(views))], indent=1) + "\n"


def _row(views: CapturedViews, k: int) -> Mapping[str, Any]:
    K, T = views.K_px[k], views.T_world_camera[k]
    return {
        "id": k,
        "img_name": views.images[k],
        "width": int(views.sizes_px[k, 0]),
        "height": int(views.sizes_px[k, 1]),
        "position": T[:3, 3].tolist(),
        "rotation": T[:3, :3].tolist(),
        "fy": float(K[1, 1]),
        "fx": float(K[0, 0]),
        "cx": float(K[0, 2]),
        "cy": float(K[1, 2]),
    }
