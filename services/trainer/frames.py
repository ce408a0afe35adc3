"""Decoded frames, kept in memory up to a limit."""

import numpy as np

from readygo.common.arrays import Int64Array, UInt8Array
from readygo.common.errors import DatasetError
from readygo.common.images.encoded import decode_image
from readygo.common.images.files import decode_output
from readygo.common.images.names import GOAL_IMAGE, RGB, kind_of
from readygo.common.policy.sight import as_measured, channels_of, in_bytes, side_by_side
from readygo.common.robot import RobotConfig
from readygo.services.trainer.pooling import pool, thin_pixels
from readygo.services.trainer.reservoir import Reservoir
from readygo.services.trainer.samples import TrainingSamples

_AT_GOAL = -1
"""Stands for the episode's goal instead of a step."""


class FrameCache:
    """Frames of a reservoir's episodes, pooled as the network takes them; those asked for first stay decoded.

    A frame that does not fit is decoded at each use.
    """

    def __init__(
        self,
        reservoir: Reservoir,
        robot: RobotConfig,
        *,
        pooling: int,
        limit_bytes: int,
        images: tuple[str, ...] = (RGB,),
    ) -> None:
        camera = robot.camera
        self._reservoir, self._robot, self._pooling, self._images = reservoir, robot, pooling, images
        self._size = (camera.height_px, camera.width_px, 3)
        self.shape = (camera.height_px // pooling, camera.width_px // pooling, channels_of(images))
        """Shape of a frame as the network takes it: rows, columns, channels."""
        self._kept: dict[str, dict[int, UInt8Array]] = {}
        self._room = limit_bytes // int(np.prod(self.shape))
        self._version = reservoir.version

    def get(self, table: TrainingSamples, indices: Int64Array) -> UInt8Array:
        """Frames of the samples `indices`, the images that were asked for side by side, shape (F, H, W, C).

        Index -1 - e is the image of the goal of the table's episode e.

        Raises:
            DatasetError: If a frame is damaged, or does not have the size of the robot's camera.
        """
        self._forget_dropped()
        frames = np.empty((len(indices), *self.shape), np.uint8)
        goals = indices < 0
        episodes = np.where(goals, -1 - indices, table.episode[indices])
        steps = np.where(goals, _AT_GOAL, indices - table.first[indices])
        places = zip(episodes.tolist(), steps.tolist(), strict=True)
        for row, (episode, step) in enumerate(places):
            frames[row] = self._frame(table.names[episode], step)
        return frames

    def _frame(self, name: str, step: int) -> UInt8Array:
        kept = self._kept.setdefault(name, {})
        if step in kept:
            return kept[step]
        frame = side_by_side({image: self._image(name, step, image) for image in self._images}, self._images)
        if self._room > 0:
            self._room -= 1
            kept[step] = frame
        return frame

    def _image(self, name: str, step: int, image: str) -> UInt8Array:
        """One of the images of a frame, pooled: rgb, shape (H, W, 3), or what is measured of depths, shape (H, W)."""
        episode, kind = self._reservoir.episodes[name], kind_of(image)
        if step == _AT_GOAL:
            file = episode.outputs[GOAL_IMAGE][0]
        else:
            file = episode.images[step] if image == RGB else episode.outputs[image][step]
        drawn = decode_image(file) if kind == RGB else decode_output(kind, file)
        size = self._size if kind == RGB else self._size[:2]
        if drawn is None or drawn.shape != size:
            found = "no" if drawn is None else f"of shape {drawn.shape} the"
            raise DatasetError(
                f"Sample {step} of episode {name} has {found} {image} image, the robot's camera gives {size}; "
                "train on data of one robot.toml."
            )
        if kind == RGB:
            return pool(drawn, self._pooling)
        measured_m = as_measured(drawn, image, self._robot, name, step)
        return thin_pixels(in_bytes(measured_m, image, self._robot), self._pooling)

    def _forget_dropped(self) -> None:
        if self._version == self._reservoir.version:
            return
        self._version = self._reservoir.version
        for name in [name for name in self._kept if name not in self._reservoir.episodes]:
            self._room += len(self._kept.pop(name))
