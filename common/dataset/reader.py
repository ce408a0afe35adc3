"""Recorded episodes as arrays and images, independent of the shards that hold them."""

import hashlib
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import (
    AnyArray,
    BoolArray,
    Float32Array,
    Float64Array,
    Int32Array,
    Int64Array,
    RecordArray,
    UInt8Array,
    UInt32Array,
)
from readygo.common.camera import SensorConfig
from readygo.common.dataset.agreement import check_alike
from readygo.common.dataset.calibration import Calibration, Calibrations
from readygo.common.dataset.chunk import parse
from readygo.common.dataset.entries import EpisodeEntry, entries_of, episode_order
from readygo.common.dataset.expert_commands import commands_of, spread
from readygo.common.dataset.humans import humans_of_shard
from readygo.common.dataset.index import load_index
from readygo.common.dataset.labels import boxes_of, footprints_of, joints_of
from readygo.common.dataset.places import find_shards
from readygo.common.dataset.provenance import Provenance
from readygo.common.dataset.sample_table import SampleTable
from readygo.common.dataset.schemas import EXPERT, LABEL_CHANNELS, OPTIONAL_CHANNELS, further_cameras, is_image
from readygo.common.dataset.shard_files import ShardFiles
from readygo.common.errors import DatasetError
from readygo.common.images.encoded import decode_image
from readygo.common.images.files import decode_output
from readygo.common.images.names import GOAL_IMAGE, RGB, camera_of, kind_of
from readygo.common.policy.windows import window_rows
from readygo.common.robot import Clock, RobotConfig
from readygo.common.robot.command_grid import UNKNOWN_RISK, command_grid

_TRUTH = ("human_distance_m", "time_to_collision_s", "expert_cost", "human_visible", "replanned")


class Dataset:
    """All episodes of some folders.

    Episodes come folder by folder, by seed, split and index within a folder: how they were spread over shards does not
    show. Shards that are still written (".part") are left out.
    """

    def __init__(self, folders: str | Path | Sequence[str | Path]) -> None:
        """Open the shards of one or more folders.

        Args:
            folders: Data folders, as `readygo generate --out` wrote them.

        Raises:
            DatasetError: If a folder is missing or has no shards, a shard is truncated, an episode is there twice, or
                image sizes or robots differ.
        """
        places = [folders] if isinstance(folders, str | Path) else folders
        found = [(number, shard) for number, folder in enumerate(places) for shard in find_shards(folder)]
        self.shards: tuple[Path, ...] = tuple(shard for _, shard in found)
        """Paths of the shards, in the order of the folders."""
        indexes = [load_index(shard) for shard in self.shards]
        check_alike(self.shards, indexes)
        self.provenance: Provenance = indexes[0].provenance
        """What the first shard says about its run; robot and image size are the same in all."""
        self.height_px, self.width_px = (int(indexes[0].episodes[0][name]) for name in ("height_px", "width_px"))
        self._order = episode_order([number for number, _ in found], indexes)
        self.episodes: tuple[EpisodeEntry, ...] = entries_of(self.shards, indexes, self._order)
        """Every episode, in the order of the samples."""
        self._files = ShardFiles(self.shards)
        self._sound = bytearray(len(self.episodes))
        """True for episodes whose bytes were checked."""
        self._table = SampleTable.of(indexes, self._order)
        channels = self._table.payloads
        self.outputs: tuple[str, ...] = (RGB, *filter(is_image, channels))
        """Names of the images that every sample has, see `readygo.common.images.names`."""
        self.has_goal_images: bool = GOAL_IMAGE in channels
        """True if every episode has an image of its goal."""
        self.labels: tuple[str, ...] = tuple(name for name in channels if name in LABEL_CHANNELS)
        """Names of the labels of people that every sample has: "joints", "boxes" and "footprints", or none."""
        self.has_expert: bool = EXPERT in channels
        """True if the expert was asked wherever there is an image: `expert_actions` and `expert_ahead` are there."""
        self._calibrations = Calibrations.of(indexes, self._order, further_cameras(self.outputs))
        self.episode_of_sample: Int32Array = self._table.episode
        """Row in `episodes` of each sample, shape (S,)."""
        self.pictured: BoolArray = self._table.rows["image_length"] > 0
        """True where a sample has an image, shape (S,): everywhere, but for episodes whose camera was slower."""

    def __len__(self) -> int:
        return len(self._table.rows)

    @cached_property
    def actions(self) -> Float32Array:
        """Commands executed after each sample: v [m/s], w [rad/s], shape (S, 2)."""
        return np.ascontiguousarray(self._table.rows["action"])

    @property
    def expert_actions(self) -> Float32Array:
        """What the expert would have executed after each sample: v [m/s], w [rad/s], shape (S, 2).

        NaN at samples without an image.

        Raises:
            DatasetError: If the data holds no labels of the expert.
        """
        return self._expert_commands[:, 0]

    @property
    def expert_ahead(self) -> Float32Array:
        """The expert's commands at the K steps after the next: v [m/s], w [rad/s], shape (S, K, 2).

        NaN at samples without an image.

        Raises:
            DatasetError: If the data holds no labels of the expert.
        """
        return self._expert_commands[:, 1:]

    @cached_property
    def risks(self) -> UInt8Array:
        """What would have become of the robot under each command of `readygo.common.robot.command_grid`, shape (S, C).

        0 nothing, 1 a collision with an obstacle, 2 one with a human, `UNKNOWN_RISK` at samples without an image.

        Raises:
            DatasetError: If samples with images lack their risks.
        """
        if not self.has_risks:
            raise DatasetError(
                f"The samples of {self.shards[0].parent} have no risks of commands; record with this version and "
                "`readygo generate --policy` or --driver.disturbed."
            )
        known = np.frombuffer(b"".join(self._risk_rows), np.uint8).reshape(-1, len(command_grid(self.robot)))
        return spread(known, self._asked, UNKNOWN_RISK)

    @cached_property
    def has_risks(self) -> bool:
        """True if every sample with an image says what each command would have led to."""
        command_count = len(command_grid(self.robot))
        return self.has_expert and all(len(row) == command_count for row in self._risk_rows)

    @cached_property
    def _risk_rows(self) -> list[bytes]:
        return [message.risks for message in self._expert_messages()]

    @cached_property
    def _asked(self) -> BoolArray:
        """True for samples that have a message of the expert, shape (S,)."""
        return np.asarray(self._table.payloads[EXPERT]["length"] > 0)

    @cached_property
    def _expert_commands(self) -> Float32Array:
        """The expert's commands v [m/s], w [rad/s] at this and K further steps, shape (S, 1 + K, 2); NaN: not asked."""
        if not self.has_expert:
            raise DatasetError(
                f"The samples of {self.shards[0].parent} have no commands of the expert; record with "
                "`readygo generate --driver.disturbed` or `--policy`."
            )
        return spread(commands_of(self._expert_messages()), self._asked, np.nan)

    def _expert_messages(self) -> Iterator[Any]:
        """The messages of the expert, in the order of the samples that have one."""
        return (self._message(index, EXPERT) for index in np.flatnonzero(self._asked).tolist())

    @property
    def image_sizes(self) -> UInt32Array:
        """Size of each sample's encoded image [bytes], shape (S,); 0 where it has none."""
        return np.asarray(self._table.rows["image_length"])

    @cached_property
    def goals_xy_m(self) -> Float32Array:
        """Goal in the robot's frame at each sample [m], shape (S, 2)."""
        return np.ascontiguousarray(self._table.rows["goal_xy_m"])

    @cached_property
    def time_ns(self) -> Int64Array:
        """Simulated time since the episode began [ns], shape (S,)."""
        return np.ascontiguousarray(self._table.rows["time_ns"])

    @cached_property
    def poses(self) -> Float64Array:
        """Robot on the floor: x, y, z [m], yaw [rad] in [-pi, pi], shape (S, 4)."""
        return np.ascontiguousarray(self._table.rows["pose"])

    @property
    def truth(self) -> RecordArray:
        """What the robot does not know, shape (S,).

        Fields human_distance_m, time_to_collision_s, expert_cost, human_visible, replanned.
        """
        return self._table.rows[list(_TRUTH)]

    @cached_property
    def robot(self) -> RobotConfig | None:
        """The robot that the samples were recorded with, None if the shards do not say.

        If it has ranges, each episode has one of its robots: `robot.with_values(episode.drawn)`.
        """
        return self.provenance.robot

    @cached_property
    def clock(self) -> Clock:
        """The steps of the samples, and at which of them there are commands and images."""
        return self.robot.clock if self.robot is not None else Clock()

    @cached_property
    def sensor(self) -> SensorConfig:
        """What varied of the robot's camera from episode to episode."""
        return self.provenance.sensor

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 over the hashes of all episodes; independent of the order of folders and of the shards."""
        return hashlib.sha256("\n".join(sorted(entry.sha256 for entry in self.episodes)).encode()).hexdigest()

    def image(self, index: int) -> bytes:
        """The encoded image of a sample; empty where it has none, see `pictured`.

        Args:
            index: Number of the sample.

        Raises:
            DatasetError: If the bytes of its episode are damaged; they are checked once, when the first is read.
        """
        row = self._table.rows[index]
        return self._read(index, int(row["image_offset"]), int(row["image_length"]))

    def decode(self, index: int) -> UInt8Array:
        """The image of a sample, sRGB, shape (H, W, 3).

        Args:
            index: Number of the sample.

        Raises:
            DatasetError: If there is none, or it cannot be decoded or has another size than the dataset's.
        """
        if not self.pictured[index]:
            raise DatasetError(f"Sample {index} in {self._shard_of(index)} has no image; `pictured` tells which have.")
        image = decode_image(self.image(index))
        if image is None or image.shape != (self.height_px, self.width_px, 3):
            raise DatasetError(f"The image of sample {index} in {self._shard_of(index)} is damaged.")
        return image

    def output(self, index: int, name: str) -> bytes:
        """The encoded image of a sample's output, see `readygo.common.images.files`; "rgb" is `image`.

        Args:
            index: Number of the sample.
            name: One of `outputs`.

        Raises:
            DatasetError: If not all samples have this output.
        """
        if name not in self.outputs:
            raise DatasetError(
                f"The samples of {self.shards[0].parent} have no {name!r} images, they have {', '.join(self.outputs)}; "
                "record others with `readygo generate --outputs`."
            )
        if name == "rgb":
            return self.image(index)
        return self._payload(index, name)

    def decode_output(self, index: int, name: str) -> AnyArray:
        """The image of a sample's output.

        Args:
            index: Number of the sample.
            name: One of `outputs`.

        Returns:
            Depths [m] float32 with inf where there is nothing or beyond 65.535 m, alpha float32, mask uint8, all of
            shape (H, W); normals float32 in the camera's frame, 0 where there is nothing, shape (H, W, 3); rgb as
            `decode`. Cameras besides the first one may have images of other sizes.

        Raises:
            DatasetError: If not all samples have this output, or the image is damaged or of another size.
        """
        if name == RGB:
            return self.decode(index)
        data, kind, of = self.output(index, name), kind_of(name), self.calibration(index, camera_of(name))
        image: AnyArray | None = decode_image(data) if kind == RGB else decode_output(kind, data)
        if image is None or image.shape[:2] != (of.height_px, of.width_px):
            raise DatasetError(f"The {name} image of sample {index} in {self._shard_of(index)} is damaged.")
        return image

    def goal_image(self, number: int) -> bytes:
        """The encoded image of what the first camera shows at the goal of an episode.

        Args:
            number: Row in `episodes`.

        Raises:
            DatasetError: If not all episodes have one.
        """
        if not self.has_goal_images:
            raise DatasetError(
                f"The episodes of {self.shards[0].parent} have no images of their goals; record them with goal_image = "
                "true under [renderer]."
            )
        return self._payload(self.episodes[number].first_sample, GOAL_IMAGE)

    def joints_m(self, index: int) -> Float32Array:
        """Joints of SMPL of everybody in the world at a sample [m], the pelvis first, shape (H, 24, 3).

        Args:
            index: Number of the sample.

        Raises:
            DatasetError: If not all samples have labels.
        """
        return joints_of(self._label(index, "joints"))

    def boxes(self, index: int) -> Float64Array:
        """Boxes around everybody at a sample: centre x, y, z, length, width, height [m], yaw [rad], shape (H, 7).

        Args:
            index: Number of the sample.

        Raises:
            DatasetError: If not all samples have labels.
        """
        return boxes_of(self._label(index, "boxes"))

    def footprints_xy_m(self, index: int) -> tuple[Float32Array, ...]:
        """Ground points below everybody at a sample [m], one array of shape (P, 2) per human.

        Args:
            index: Number of the sample.

        Raises:
            DatasetError: If not all samples have labels.
        """
        return footprints_of(self._label(index, "footprints"))

    @cached_property
    def humans_xyzyaw(self) -> tuple[Float64Array, ...]:
        """Every human at each sample, with labels or without: x, y, z [m], yaw [rad], one array (H, 4) per sample.

        All shards are read for it, once.

        Raises:
            DatasetError: If a shard is damaged.
        """
        of_shard = [humans_of_shard(shard) for shard in self.shards]
        return tuple(poses for shard, row in self._order for poses in of_shard[shard][row])

    def humans_of(self, number: int) -> tuple[Float64Array, ...]:
        """Every human at each sample of an episode, see `humans_xyzyaw`; only the episode is read.

        Args:
            number: Row in `episodes`.

        Raises:
            DatasetError: If the episode is damaged.
        """
        shard, row = self._order[number]
        return tuple(humans_of_shard(self.shards[shard], only=row)[0])

    def calibration(self, index: int, camera: str = "") -> Calibration:
        """A camera that made images of a sample.

        Args:
            index: Number of the sample.
            camera: Name of a camera besides the first one.

        Raises:
            DatasetError: If there is no such camera.
        """
        return self._calibrations.calibration(int(self.episode_of_sample[index]), camera)

    def windows(self, samples: npt.ArrayLike | None = None, *, spacing_s: float = 0.5) -> Int64Array:
        """Samples whose images a policy sees together; an episode's first image stands in for what was before.

        Args:
            samples: The newest sample of each window, shape (N,); all samples by default.
            spacing_s: Time between images [s], a multiple of the time between those of the camera.

        Returns:
            Sample numbers, the oldest first, shape (N, 3).

        Raises:
            ValueError: If the spacing is none.
        """
        newest = np.arange(len(self)) if samples is None else np.asarray(samples, dtype=np.int64)
        steps, every = self.clock.spacing_steps(spacing_s), self.clock.image_every
        return window_rows(newest, self._table.first[newest], steps, image_every=every)

    def close(self) -> None:
        """Close the shards; images can still be read, they are opened again."""
        self._files.close()

    def _label(self, index: int, name: str) -> Any:
        """The message with one kind of labels of a sample."""
        if name not in self.labels:
            raise DatasetError(
                f"The samples of {self.shards[0].parent} have no labels of people; record with labels = true under "
                "[renderer], the default."
            )
        return self._message(index, name)

    def _message(self, index: int, name: str) -> Any:
        """The message of a sample on an optional channel that has no images."""
        return parse(OPTIONAL_CHANNELS[name], memoryview(self._payload(index, name)))

    def _payload(self, index: int, name: str) -> bytes:
        """What a sample has on an optional channel: an encoded image, or a message."""
        row = self._table.payloads[name][index]
        return self._read(index, int(row["offset"]), int(row["length"]))

    def _read(self, index: int, offset: int, length: int) -> bytes:
        """Bytes of a sample; those of its whole episode are checked when the first of them are read."""
        number = int(self.episode_of_sample[index])
        if not self._sound[number]:
            if not self._files.is_sound(*self._order[number]):
                episode = self.episodes[number]
                raise DatasetError(
                    f"Episode {episode.episode.episode_id} in {episode.shard} is damaged: its bytes do not match their "
                    f"CRC-32; see `readygo validate {episode.shard.parent}`."
                )
            self._sound[number] = True
        return self._files.read(int(self._table.shard[index]), offset, length)

    def _shard_of(self, index: int) -> Path:
        return self.shards[int(self._table.shard[index])]
