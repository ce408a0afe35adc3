"""Recorded episodes as arrays and images, whatever the shards they are in."""

import hashlib
import mmap
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from mcap.opcode import Opcode

from readygo.common.camera import SensorConfig
from readygo.common.config import section_differences
from readygo.common.dataset.chunk import parse
from readygo.common.dataset.index import ShardIndex, load_index, mapped
from readygo.common.dataset.labels import boxes_of, footprints_of, joints_of
from readygo.common.dataset.places import shard_folders
from readygo.common.dataset.poses import pose_xyzyaw
from readygo.common.dataset.provenance import Provenance
from readygo.common.dataset.records import chunk_span, iter_messages, iter_records
from readygo.common.dataset.schemas import (
    EXPERT,
    HUMANS,
    LABEL_CHANNELS,
    OPTIONAL_CHANNELS,
    Ending,
    further_cameras,
    is_image,
)
from readygo.common.errors import DatasetError
from readygo.common.images.encoded import decode_pixels
from readygo.common.images.files import decode_output
from readygo.common.images.names import GOAL_IMAGE, RGB, camera_of, kind_of
from readygo.common.messages.episode import EpisodeKey
from readygo.common.messages.plan import Driver, Outcome
from readygo.common.messages.samples import DISTORTION_MODELS
from readygo.common.policy.windows import window_rows
from readygo.common.robot import Clock, RobotConfig
from readygo.common.robot.command_grid import UNKNOWN_RISK, command_grid

_CALIBRATION = ("height_px", "width_px", "K_px", "distortion_model", "distortion")
OPEN_SHARDS_MAX = 128
"""Shards that are mapped at the same time; each holds a file descriptor."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """The camera of an episode."""

    height_px: int
    """Image height."""
    width_px: int
    """Image width."""
    K_px: npt.NDArray[np.float64]
    """Intrinsics [px] with pixel centres at +0.5, shape (3, 3)."""
    distortion_model: str
    """One of `readygo.common.messages.samples.DISTORTION_MODELS`; "" is a pinhole camera."""
    distortion: tuple[float, ...]
    """Coefficients of the model."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeEntry:
    """One episode of a dataset."""

    episode: EpisodeKey
    """Which episode of its run it is."""
    first_sample: int
    """The episode's first row in the dataset's arrays."""
    sample_count: int
    """Rows of the episode, `Dataset.clock.rate_hz` a second."""
    attempt: int
    """How often the episode was begun until it was recorded."""
    shard: Path
    """The file that holds it."""
    sha256: str
    """SHA-256 of the episode's bytes, the same on every worker."""
    outcome: Outcome = Outcome.SUCCESS
    """How it ended; the samples before a collision are there."""
    driver: Driver = Driver.EXPERT
    """Who drove."""
    policy: str = ""
    """SHA-256 over the files of the policy that drove; empty for the expert."""
    drawn: Mapping[str, float] = field(default_factory=dict, hash=False)
    """What its robot drew from the ranges of `Dataset.robot`: see `RobotConfig.with_values`."""


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
        """The files."""
        indexes = [load_index(shard) for shard in self.shards]
        _check_alike(self.shards, indexes)
        self.provenance: Provenance = indexes[0].provenance
        """What the first shard says about its run; robot and image size are the same in all."""
        self.height_px, self.width_px = (int(indexes[0].episodes[0][name]) for name in ("height_px", "width_px"))
        order = _episode_order([number for number, _ in found], indexes)
        self.episodes: tuple[EpisodeEntry, ...] = _entries(self.shards, indexes, order)
        """Every episode, in the order of the samples."""
        _check_unique(self.episodes)
        rows = np.concatenate([_episode_rows(indexes[shard], row) for shard, row in order])
        counts = np.array([entry.sample_count for entry in self.episodes])
        self._order = order
        self._shard_of_sample = np.repeat(np.array([shard for shard, _ in order], dtype=np.int32), counts)
        self._rows = rows
        common = _common_outputs(indexes)
        self.outputs: tuple[str, ...] = (RGB, *filter(is_image, common))
        """Names of the images that every sample has, see `readygo.common.images.names`."""
        self.has_goal_images: bool = GOAL_IMAGE in common
        """True if every episode has an image of its goal."""
        self.labels: tuple[str, ...] = tuple(name for name in common if name in LABEL_CHANNELS)
        """Names of the labels of people that every sample has: "joints", "boxes" and "footprints", or none."""
        self.has_expert: bool = EXPERT in common
        """True if the expert was asked wherever there is an image: `expert_actions` and `expert_ahead` are there."""
        self._output_rows = {
            name: np.concatenate([_episode_rows(indexes[shard], row, name) for shard, row in order]) for name in common
        }
        self._calibrations = np.array([indexes[shard].episodes[row] for shard, row in order])[list(_CALIBRATION)]
        self._cameras = {
            camera: np.array([indexes[shard].cameras[row, place] for shard, row in order])
            for place, camera in enumerate(further_cameras(self.outputs))
        }
        self.episode_of_sample: npt.NDArray[np.int32] = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
        """Row in `episodes` of each sample, shape (S,)."""
        self._first_sample = np.repeat(np.cumsum(counts) - counts, counts)
        self._maps: OrderedDict[int, mmap.mmap] = OrderedDict()
        self.pictured: npt.NDArray[np.bool_] = self._rows["image_length"] > 0
        """True where a sample has an image, shape (S,): everywhere, but for episodes whose camera was slower."""

    def __len__(self) -> int:
        return len(self._rows)

    def __getstate__(self) -> dict[str, Any]:
        # Memory maps cannot be pickled; a data loader's worker opens its own.
        return {**self.__dict__, "_maps": OrderedDict()}

    @cached_property
    def actions(self) -> npt.NDArray[np.float32]:
        """Commands executed after each sample: v [m/s], w [rad/s], shape (S, 2)."""
        return np.ascontiguousarray(self._rows["action"])

    @property
    def expert_actions(self) -> npt.NDArray[np.float32]:
        """What the expert would have executed after each sample: v [m/s], w [rad/s], shape (S, 2).

        NaN at samples without an image.

        Raises:
            DatasetError: If nobody asked it.
        """
        return self._expert_commands[:, 0]

    @property
    def expert_ahead(self) -> npt.NDArray[np.float32]:
        """What it would have gone on with, at every further step: v [m/s], w [rad/s], shape (S, K, 2); NaN like them.

        Raises:
            DatasetError: If nobody asked it.
        """
        return self._expert_commands[:, 1:]

    @cached_property
    def risks(self) -> npt.NDArray[np.uint8]:
        """What would have become of the robot under each command of `readygo.common.robot.command_grid`, shape (S, C).

        0 nothing, 1 a collision with an obstacle, 2 one with a human, `UNKNOWN_RISK` at samples without an image.

        Raises:
            DatasetError: If nobody looked at all samples with images.
        """
        if not self.has_risks:
            raise DatasetError(
                f"The samples of {self.shards[0].parent} have no risks of commands; record with this version and "
                "`readygo generate --policy` or --disturb."
            )
        known = np.frombuffer(b"".join(self._risk_rows), np.uint8).reshape(-1, self._command_count)
        return self._spread(known, UNKNOWN_RISK)

    @cached_property
    def has_risks(self) -> bool:
        """True if every sample with an image says what each command would have led to."""
        return self.has_expert and all(len(row) == self._command_count for row in self._risk_rows)

    @cached_property
    def _command_count(self) -> int:
        """Commands of the robot's grid."""
        return len(command_grid(self.robot))

    @cached_property
    def _risk_rows(self) -> list[bytes]:
        return [self._message(index, EXPERT).risks for index in np.flatnonzero(self._asked).tolist()]

    @cached_property
    def _asked(self) -> npt.NDArray[np.bool_]:
        """Where there is a message of the expert, shape (S,)."""
        return np.asarray(self._output_rows[EXPERT]["length"] > 0)

    def _spread(self, rows: npt.NDArray[Any], missing: float) -> npt.NDArray[Any]:
        """Rows of the samples at which the expert was asked, as rows of all samples."""
        if self._asked.all():
            return rows
        spread = np.full((len(self), *rows.shape[1:]), missing, rows.dtype)
        spread[self._asked] = rows
        return spread

    @cached_property
    def _expert_commands(self) -> npt.NDArray[np.float32]:
        """Shape (S, 1 + K, 2)."""
        if not self.has_expert:
            raise DatasetError(
                f"The samples of {self.shards[0].parent} have no commands of the expert; record with "
                "`readygo generate --disturb` or `--policy`."
            )
        messages = (self._message(index, EXPERT) for index in np.flatnonzero(self._asked).tolist())
        rows = [(message.v_mps, message.w_radps) for message in messages]
        try:
            known = np.ascontiguousarray(np.array(rows, dtype=np.float32).transpose(0, 2, 1))
        except ValueError as error:
            raise DatasetError(
                "The expert's commands reach differently far ahead; use the folders as separate datasets."
            ) from error
        return self._spread(known, np.nan)

    @property
    def image_sizes(self) -> npt.NDArray[np.uint32]:
        """Size of each sample's encoded image [bytes], shape (S,); 0 where it has none."""
        return np.asarray(self._rows["image_length"])

    @cached_property
    def goals_xy_m(self) -> npt.NDArray[np.float32]:
        """Goal in the robot's frame at each sample [m], shape (S, 2)."""
        return np.ascontiguousarray(self._rows["goal_xy_m"])

    @cached_property
    def time_ns(self) -> npt.NDArray[np.int64]:
        """Simulated time since the episode began [ns], shape (S,)."""
        return np.ascontiguousarray(self._rows["time_ns"])

    @cached_property
    def poses(self) -> npt.NDArray[np.float64]:
        """Robot on the floor: x, y, z [m], yaw [rad] in [-pi, pi], shape (S, 4)."""
        return np.ascontiguousarray(self._rows["pose"])

    @property
    def truth(self) -> npt.NDArray[np.void]:
        """What the robot does not know, shape (S,).

        Fields human_distance_m, time_to_collision_s, expert_cost, human_visible, replanned.
        """
        return self._rows[["human_distance_m", "time_to_collision_s", "expert_cost", "human_visible", "replanned"]]

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
        """
        row = self._rows[index]
        offset = int(row["image_offset"])
        return self._map(int(self._shard_of_sample[index]))[offset : offset + int(row["image_length"])]

    def decode(self, index: int) -> npt.NDArray[np.uint8]:
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
        row = self._output_rows[name][index]
        offset = int(row["offset"])
        return self._map(int(self._shard_of_sample[index]))[offset : offset + int(row["length"])]

    def decode_output(self, index: int, name: str) -> npt.NDArray[Any]:
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
        image: npt.NDArray[Any] | None = decode_image(data) if kind == RGB else decode_output(kind, data)
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
        first = self.episodes[number].first_sample
        row = self._output_rows[GOAL_IMAGE][first]
        offset = int(row["offset"])
        return self._map(int(self._shard_of_sample[first]))[offset : offset + int(row["length"])]

    def joints_m(self, index: int) -> npt.NDArray[np.float32]:
        """Joints of SMPL of everybody in the world at a sample [m], the pelvis first, shape (H, 24, 3).

        Args:
            index: Number of the sample.

        Raises:
            DatasetError: If not all samples have labels.
        """
        return joints_of(self._label(index, "joints"))

    def boxes(self, index: int) -> npt.NDArray[np.float64]:
        """Boxes around everybody at a sample: centre x, y, z, length, width, height [m], yaw [rad], shape (H, 7).

        Args:
            index: Number of the sample.

        Raises:
            DatasetError: If not all samples have labels.
        """
        return boxes_of(self._label(index, "boxes"))

    def footprints_xy_m(self, index: int) -> tuple[npt.NDArray[np.float32], ...]:
        """Ground points below everybody at a sample [m], one array of shape (P, 2) per human.

        Args:
            index: Number of the sample.

        Raises:
            DatasetError: If not all samples have labels.
        """
        return footprints_of(self._label(index, "footprints"))

    @cached_property
    def humans_xyzyaw(self) -> tuple[npt.NDArray[np.float64], ...]:
        """Every human at each sample, with labels or without: x, y, z [m], yaw [rad], one array (H, 4) per sample.

        All shards are read for it, once.

        Raises:
            DatasetError: If a shard is damaged.
        """
        of_shard = [_humans_of_shard(shard) for shard in self.shards]
        return tuple(poses for shard, row in self._order for poses in of_shard[shard][row])

    def humans_of(self, number: int) -> tuple[npt.NDArray[np.float64], ...]:
        """Every human at each sample of an episode, see `humans_xyzyaw`; only the episode's shard is read.

        Args:
            number: Row in `episodes`.

        Raises:
            DatasetError: If the shard is damaged.
        """
        shard, row = self._order[number]
        return tuple(_humans_of_shard(self.shards[shard])[row])

    def calibration(self, index: int, camera: str = "") -> Calibration:
        """A camera that made images of a sample.

        Args:
            index: Number of the sample.
            camera: Name of a camera besides the first one.

        Raises:
            DatasetError: If there is no such camera.
        """
        if camera and camera not in self._cameras:
            known = ", ".join(self._cameras) or "none"
            raise DatasetError(f"The samples have no camera {camera!r}; besides the first they have {known}.")
        row = (self._cameras[camera] if camera else self._calibrations)[self.episode_of_sample[index]]
        model = row["distortion_model"].decode()
        return Calibration(
            height_px=int(row["height_px"]),
            width_px=int(row["width_px"]),
            K_px=row["K_px"].reshape(3, 3).copy(),
            distortion_model=model,
            distortion=tuple(row["distortion"][: DISTORTION_MODELS[model]].tolist()),
        )

    def windows(self, samples: npt.ArrayLike | None = None, *, spacing_s: float = 0.5) -> npt.NDArray[np.int64]:
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
        return window_rows(newest, self._first_sample[newest], steps, image_every=every)

    def close(self) -> None:
        """Close the shards; images can still be read, they are opened again."""
        while self._maps:
            self._maps.popitem()[1].close()

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
        row = self._output_rows[name][index]
        offset = int(row["offset"])
        data = self._map(int(self._shard_of_sample[index]))[offset : offset + int(row["length"])]
        return parse(OPTIONAL_CHANNELS[name], memoryview(data))

    def _shard_of(self, index: int) -> Path:
        return self.shards[int(self._shard_of_sample[index])]

    def _map(self, shard: int) -> mmap.mmap:
        if shard in self._maps:
            self._maps.move_to_end(shard)
            return self._maps[shard]
        while len(self._maps) >= OPEN_SHARDS_MAX:
            self._maps.popitem(last=False)[1].close()
        with self.shards[shard].open("rb") as file:
            self._maps[shard] = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        return self._maps[shard]


def _humans_of_shard(shard: Path) -> list[list[npt.NDArray[np.float64]]]:
    """Humans at every sample of every episode, in the order of the shard."""
    episodes = []
    with mapped(shard) as view:
        for record in iter_records(view):
            if record.opcode != Opcode.CHUNK:
                continue
            span = chunk_span(view, record)
            found = (m for m in iter_messages(view, span.body, span.end) if m.channel == HUMANS.number)
            poses = (parse(HUMANS, view[message.body : message.end]).poses for message in found)
            episodes.append([np.array([pose_xyzyaw(pose) for pose in each]).reshape(-1, 4) for each in poses])
    return episodes


def find_shards(folder: str | Path) -> list[Path]:
    """The finished shards of a folder, by name.

    Raises:
        DatasetError: If the folder is missing or has none.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise DatasetError(f"Data folder {folder} does not exist; record one with `readygo generate`.")
    shards = [shard for place in shard_folders(folder) for shard in sorted(place.glob("shard-*.mcap"))]
    if not shards:
        open_count = len(list(folder.glob("shard-*.mcap.part")))
        hint = f"{open_count} are still being written" if open_count else "record some with `readygo generate`"
        raise DatasetError(f"Data folder {folder} holds no finished shards (shard-*.mcap); {hint}.")
    return shards


def decode_image(data: bytes) -> npt.NDArray[np.uint8] | None:
    """An encoded image as sRGB, shape (H, W, 3); None if it cannot be decoded."""
    import cv2

    bgr = decode_pixels(data, cv2.IMREAD_COLOR)
    if bgr is None:
        return None
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def _episode_order(folders: Sequence[int], indexes: Sequence[ShardIndex]) -> list[tuple[int, int]]:
    """(shard, row) of every episode in the dataset's order; `folders` has the number of each shard's data folder."""

    def rank(place: tuple[int, int]) -> tuple[Any, ...]:
        episode = indexes[place[0]].episodes[place[1]]
        return folders[place[0]], episode["seed"], episode["split"], episode["index"]

    places = [(shard, row) for shard, index in enumerate(indexes) for row in range(len(index.episodes))]
    return sorted(places, key=rank)


def _entries(
    shards: Sequence[Path], indexes: Sequence[ShardIndex], order: Sequence[tuple[int, int]]
) -> tuple[EpisodeEntry, ...]:
    entries: list[EpisodeEntry] = []
    first_sample = 0
    for shard, row in order:
        episode = indexes[shard].episodes[row]
        ending = indexes[shard].ending(row)
        entry = EpisodeEntry(
            episode=indexes[shard].episode_key(row),
            first_sample=first_sample,
            sample_count=int(episode["sample_count"]),
            attempt=int(episode["attempt"]),
            shard=shards[shard],
            sha256=episode["sha256"].decode(),
            outcome=ending.outcome,
            driver=ending.driver,
            policy=_policy_of(ending, indexes[shard].provenance),
            drawn=indexes[shard].drawn[row] if indexes[shard].drawn else {},
        )
        entries.append(entry)
        first_sample += entry.sample_count
    return tuple(entries)


def _policy_of(ending: Ending, provenance: Provenance) -> str:
    """The policy that drove an episode: the offered one that it names, else the run's own."""
    own = provenance.policy.sha256 if provenance.policy and ending.driver is Driver.POLICY else ""
    return ending.policy or own


def _episode_rows(index: ShardIndex, row: int, output: str = "rgb") -> npt.NDArray[np.void]:
    first = int(index.episodes[row]["first_sample"])
    rows = index.samples if output == "rgb" else index.outputs[output]
    return rows[first : first + int(index.episodes[row]["sample_count"])]


def _common_outputs(indexes: Sequence[ShardIndex]) -> list[str]:
    return [name for name in indexes[0].outputs if all(name in index.outputs for index in indexes)]


def _check_alike(shards: Sequence[Path], indexes: Sequence[ShardIndex]) -> None:
    """Raise DatasetError if image sizes, robots (with their cameras) or what varies of the cameras differ."""

    def sizes(index: ShardIndex) -> list[tuple[int, int]]:
        return sorted({(int(row["height_px"]), int(row["width_px"])) for row in index.episodes})

    first_size, first = sizes(indexes[0])[0], indexes[0].provenance
    for shard, index in zip(shards, indexes, strict=True):
        for size in sizes(index):
            if size != first_size:
                raise DatasetError(
                    f"Image sizes differ: {first_size[0]}x{first_size[1]} in {shards[0]}, {size[0]}x{size[1]} in "
                    f"{shard}; use them as separate datasets."
                )
        pairs = (("Robots", first.robot, index.provenance.robot), ("Sensors", first.sensor, index.provenance.sensor))
        for what, ours, theirs in pairs:
            if ours != theirs:
                raise DatasetError(
                    f"{what} differ: {_differing(ours, theirs)} in {shards[0]} and {shard}; use them as separate "
                    "datasets."
                )


def _differing(ours: Any, theirs: Any) -> str:
    if ours is None or theirs is None:
        return "only one names its robot"
    return ", ".join(f"{name} {our} and {their}" for name, our, their in section_differences(ours, theirs))


def _check_unique(episodes: Sequence[EpisodeEntry]) -> None:
    """Raise DatasetError if an episode is there twice; other scenes may use the same keys."""
    seen: dict[str, EpisodeEntry] = {}
    for entry in episodes:
        if entry.sha256 in seen:
            raise DatasetError(
                f"Episode {entry.episode.episode_id} is there twice, in {seen[entry.sha256].shard} and {entry.shard}; "
                "give every folder once, or have `readygo recover` leave one of two in a folder."
            )
        seen[entry.sha256] = entry
