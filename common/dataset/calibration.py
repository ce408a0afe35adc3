"""The cameras of an episode, as its shard says."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from readygo.common.arrays import Float64Array, RecordArray
from readygo.common.dataset.entries import EpisodePlace
from readygo.common.dataset.index import ShardIndex
from readygo.common.errors import DatasetError
from readygo.common.messages.samples import DISTORTION_MODELS

_FIELDS = ["height_px", "width_px", "K_px", "distortion_model", "distortion"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """The camera of an episode."""

    height_px: int
    """Image height [px]."""
    width_px: int
    """Image width [px]."""
    K_px: Float64Array
    """Intrinsics [px] with pixel centres at +0.5, shape (3, 3)."""
    distortion_model: str
    """One of `readygo.common.messages.samples.DISTORTION_MODELS`; "" is a pinhole camera."""
    distortion: tuple[float, ...]
    """Coefficients of the distortion model."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibrations:
    """Every camera in every episode."""

    first: RecordArray
    """Calibrations of the first camera, a row per episode."""
    further: Mapping[str, RecordArray]
    """Calibrations of the other cameras by name, a row per episode."""

    @classmethod
    def of(cls, indexes: Sequence[ShardIndex], order: Sequence[EpisodePlace], cameras: Sequence[str]) -> "Calibrations":
        """The calibrations in indexes, of `cameras` besides the first one, for episodes in an order."""
        return cls(
            first=np.array([indexes[shard].episodes[row] for shard, row in order])[_FIELDS],
            further={
                camera: np.array([_row_of(indexes[shard].cameras[row], camera) for shard, row in order])
                for camera in cameras
            },
        )

    def calibration(self, episode: int, camera: str = "") -> Calibration:
        """A camera in an episode.

        Args:
            episode: Number of the episode.
            camera: Name of a camera besides the first one.

        Raises:
            DatasetError: If there is no such camera.
        """
        if camera and camera not in self.further:
            known = ", ".join(self.further) or "none"
            raise DatasetError(f"The samples have no camera {camera!r}; besides the first they have {known}.")
        row = (self.further[camera] if camera else self.first)[episode]
        model = row["distortion_model"].decode()
        return Calibration(
            height_px=int(row["height_px"]),
            width_px=int(row["width_px"]),
            K_px=row["K_px"].reshape(3, 3).copy(),
            distortion_model=model,
            distortion=tuple(row["distortion"][: DISTORTION_MODELS[model]].tolist()),
        )


def _row_of(cameras: RecordArray, name: str) -> Any:
    """A camera's row among those of an episode, whose order differs between runs."""
    return cameras[cameras["name"] == name.encode()][0]
