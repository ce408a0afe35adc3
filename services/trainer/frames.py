"""Decoded frames, kept in memory up to a limit."""

import cv2
import numpy as np
import numpy.typing as npt

from readygo.common.camera import CameraConfig
from readygo.common.camera.depth import depth_bytes, depth_rng, measured_depth
from readygo.common.dataset.reader import decode_image
from readygo.common.errors import DatasetError
from readygo.common.images.files import decode_output
from readygo.common.policy.sight import DEPTH, RGB, channels_of, side_by_side
from readygo.services.trainer.reservoir import Reservoir
from readygo.services.trainer.samples import Indices, SampleTable

Image = npt.NDArray[np.uint8]


class FrameCache:
    """Frames of a reservoir's episodes, pooled as the network takes them; those asked for first stay decoded.

    A frame that does not fit is decoded at each use.
    """

    def __init__(
        self,
        reservoir: Reservoir,
        camera: CameraConfig,
        *,
        pooling: int,
        limit_bytes: int,
        images: tuple[str, ...] = (RGB,),
    ) -> None:
        self._reservoir, self._camera, self._pooling, self._images = reservoir, camera, pooling, images
        self._size = (camera.height_px, camera.width_px, 3)
        self.shape = (camera.height_px // pooling, camera.width_px // pooling, channels_of(images))
        """Of a frame as the network takes it."""
        self._kept: dict[str, dict[int, Image]] = {}
        self._room = limit_bytes // int(np.prod(self.shape))
        self._version = reservoir.version

    def get(self, table: SampleTable, indices: Indices) -> Image:
        """Frames of the samples `indices`, the images that were asked for side by side, shape (F, H, W, C).

        Raises:
            DatasetError: If a frame is damaged, or does not have the size of the robot's camera.
        """
        self._forget_dropped()
        frames = np.empty((len(indices), *self.shape), np.uint8)
        places = zip(table.episode[indices].tolist(), (indices - table.first[indices]).tolist(), strict=True)
        for row, (episode, step) in enumerate(places):
            frames[row] = self._frame(table.names[episode], step)
        return frames

    def _frame(self, name: str, step: int) -> Image:
        kept = self._kept.setdefault(name, {})
        if step in kept:
            return kept[step]
        frame = decode_image(self._reservoir.episodes[name].images[step])
        if frame is None or frame.shape != self._size:
            found = "no image" if frame is None else f"an image of shape {frame.shape}"
            raise DatasetError(
                f"Sample {step} of episode {name} has {found}, the robot's camera gives {self._size}; "
                "train on data of one robot.toml."
            )
        frame = pool(frame, self._pooling)
        if DEPTH in self._images:
            frame = side_by_side({RGB: frame, DEPTH: self._depth(name, step)}, self._images)
        if self._room > 0:
            self._room -= 1
            kept[step] = frame
        return frame

    def _depth(self, name: str, step: int) -> Image:
        """What the camera measured of a frame's depths, in bytes, shape (H, W)."""
        depth_m = decode_output(DEPTH, self._reservoir.episodes[name].outputs[DEPTH][step])
        if depth_m is None or depth_m.shape != self._size[:2]:
            raise DatasetError(f"Sample {step} of episode {name} has no depth image of {self._size[:2]} px.")
        measured_m = measured_depth(depth_m, self._camera, depth_rng(name, step))
        return thinned(depth_bytes(measured_m, self._camera), self._pooling)

    def _forget_dropped(self) -> None:
        if self._version == self._reservoir.version:
            return
        self._version = self._reservoir.version
        for name in [name for name in self._kept if name not in self._reservoir.episodes]:
            self._room += len(self._kept.pop(name))


def pooling_of(camera: CameraConfig, pooled_height_px: int) -> int:
    """The largest whole factor that divides a camera's image and leaves the height; 1 for a height of 0."""
    if pooled_height_px == 0:
        return 1
    height, width = camera.height_px, camera.width_px
    factors = range(1, max(1, height // pooled_height_px) + 1)
    return max(factor for factor in factors if height % factor == 0 and width % factor == 0)


def thinned(depth: Image, factor: int) -> Image:
    """The pixel in the middle of every square of `factor` pixels: a mean of depths is where nothing is."""
    return depth[factor // 2 :: factor, factor // 2 :: factor]


def pool(frame: Image, factor: int) -> Image:
    """The mean of every square of `factor` pixels, halves rounded up, shape (H / factor, W / factor, 3)."""
    if factor == 1:
        return frame
    if factor == 2:
        # OpenCV rounds this one as said, and is ten times faster.
        return np.asarray(cv2.resize(frame, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.uint8)
    height, width = frame.shape[0] // factor, frame.shape[1] // factor
    sums = frame.reshape(height, factor, width, factor, 3).sum(axis=(1, 3), dtype=np.uint32)
    pooled: Image = ((2 * sums + factor * factor) // (2 * factor * factor)).astype(np.uint8)
    return pooled
