"""Keypoints of a person in images: the sets of COCO and Halpe, where they lie on the skeleton, and their file.

keypoints.npz    keypoints (F, K, 3): u, v [px], confidence 0..1; pixel centres at +0.5, rows as the images' names
                 images (F,): names of the images, optional

K chooses the set: 17 of COCO (Lin et al., Microsoft COCO, 2014), or 26 of Halpe, which begin with those of COCO and add
head, neck, hip and three points of each foot (Fang et al., AlphaPose, 2022). Left is the person's left.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from readygo.common.array_files import as_float64, load_npz
from readygo.common.arrays import BoolArray, Float64Array, Int64Array
from readygo.common.errors import AvatarError
from readygo.common.files import write_then_rename

KEYPOINTS_FILE = "keypoints.npz"
COCO17 = (
    "nose", "left_eye", "right_eye", "left_ear", "right_ear", "left_shoulder", "right_shoulder", "left_elbow",
    "right_elbow", "left_wrist", "right_wrist", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle",
    "right_ankle",
)  # fmt: skip
HALPE26 = (
    *COCO17, "head", "neck", "hip", "left_big_toe", "right_big_toe", "left_small_toe", "right_small_toe", "left_heel",
    "right_heel",
)  # fmt: skip
SETS = {len(names): names for names in (COCO17, HALPE26)}
"""Names of keypoints by their count."""
CONFIDENT = 0.3
"""Keypoints below this confidence count as not seen."""
CONFIDENCE_MAX = 1.5
"""Networks overshoot 1 a little; beyond this, numbers are no confidences."""
_SEEN_MIN, _EMPTY_FRAMES, _FEET_FRAMES_MIN = 5, 0.2, 0.2
_COVER_MIN, _COVER_MARGIN = 0.6, 0.05
_BYTES_MAX, _FAR_PX = 2**26, 1e5


@dataclass(frozen=True)
class Anchor:
    """Where a keypoint lies on a person of `ANCHOR_HEIGHT_M`."""

    joint: int
    """Joint of SMPL that it moves with."""
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """From the joint, in SMPL axes of the T-pose (x to the person's left, y up, z forward)."""
    sigma_m: float = 0.02
    """Standard deviation of the offset among people and annotators."""


ANCHOR_HEIGHT_M = 1.7
_HEAD = 15
_LEFT = {
    "left_eye": Anchor(_HEAD, (0.027, 0.04, 0.103)),
    "left_ear": Anchor(_HEAD, (0.085, 0.03, -0.005)),
    "left_shoulder": Anchor(16),
    "left_elbow": Anchor(18),
    "left_wrist": Anchor(20),
    "left_hip": Anchor(1, sigma_m=0.03),
    "left_knee": Anchor(4),
    "left_ankle": Anchor(7),
    "left_big_toe": Anchor(10, (-0.012, -0.035, 0.057)),
    "left_small_toe": Anchor(10, (0.031, -0.035, 0.048)),
    "left_heel": Anchor(7, (0.01, -0.075, -0.05)),
}


def mirror_name(name: str) -> str:
    """The keypoint on the other side; itself in the middle."""
    side, _, rest = name.partition("_")
    return {"left": f"right_{rest}", "right": f"left_{rest}"}.get(side, name)


def _mirror(anchor: Anchor) -> Anchor:
    x, y, z = anchor.offset_m
    joint = anchor.joint if anchor.joint == _HEAD else anchor.joint + 1
    return replace(anchor, joint=joint, offset_m=(-x, y, z))


ANCHORS = {
    "nose": Anchor(_HEAD, (0.0, 0.003, 0.126)),
    "head": Anchor(_HEAD, (0.0, 0.166, 0.01)),
    "neck": Anchor(12, sigma_m=0.03),
    "hip": Anchor(0, sigma_m=0.03),
    **_LEFT,
    **{mirror_name(name): _mirror(anchor) for name, anchor in _LEFT.items()},
}
"""Anchors by the names of keypoints; those of face and feet were measured on the embedded avatars."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Keypoints:
    """Keypoints of one person in F images."""

    names: tuple[str, ...]
    """Names of the K keypoints, one of `SETS`."""
    uv_px: Float64Array
    """Shape (F, K, 2)."""
    confidence: Float64Array
    """0 to 1, shape (F, K)."""

    def __len__(self) -> int:
        return len(self.uv_px)

    @property
    def seen(self) -> BoolArray:
        """Which count as seen, shape (F, K)."""
        return self.confidence >= CONFIDENT

    def column(self, name: str) -> int:
        """The number of a keypoint."""
        return self.names.index(name)

    def with_swapped(self, swapped: BoolArray) -> "Keypoints":
        """The same with left and right exchanged where `swapped`, shape (F, K), says so."""
        other = self.mirror
        return replace(
            self,
            uv_px=np.where(swapped[..., None], self.uv_px[:, other], self.uv_px),
            confidence=np.where(swapped, self.confidence[:, other], self.confidence),
        )

    @property
    def mirror(self) -> Int64Array:
        """The number of the keypoint on the other side, shape (K,)."""
        return np.array([self.column(mirror_name(name)) for name in self.names])


def read_keypoints(path: Path, images: Sequence[str]) -> Keypoints:
    """Read keypoints of some images.

    Args:
        path: The file.
        images: Names of the images, in the order of the rows.

    Raises:
        AvatarError: If it holds other keypoints than those of a person in these images.
    """
    arrays = load_npz(path, ("keypoints", "images"), bytes_max=_BYTES_MAX, raises=AvatarError)
    if "keypoints" not in arrays:
        raise AvatarError(f"{path} lacks keypoints (F, K, 3): u, v [px] and confidence of each keypoint.")
    rows = as_float64(arrays["keypoints"], f"{path}: keypoints", raises=AvatarError)
    counts = " or ".join(str(count) for count in SETS)
    if rows.ndim != 3 or rows.shape[2] != 3 or rows.shape[1] not in SETS:
        raise AvatarError(
            f"{path}: keypoints must be (F, K, 3) with K = {counts} (COCO, Halpe with feet), got {rows.shape}."
        )
    if "images" in arrays:
        rows = _rows_of(path, [str(name) for name in arrays["images"].reshape(-1)], rows, images)
    if len(rows) != len(images):
        raise AvatarError(f"{path} has keypoints of {len(rows)} frames, but {len(images)} images have a camera.")
    return keypoints_of(rows, path)


def keypoints_of(rows: Float64Array, source: Path) -> Keypoints:
    """Keypoints of rows (F, K, 3) of u, v, confidence; what is not finite, or far from any image, counts as not seen.

    Raises:
        AvatarError: If confidences are none.
    """
    near = np.all(np.abs(rows) < _FAR_PX, axis=2, keepdims=True)
    rows = np.where(near, rows, 0.0)
    if rows[..., 2].min(initial=0.0) < 0.0 or rows[..., 2].max(initial=0.0) > CONFIDENCE_MAX:
        raise AvatarError(
            f"{source}: confidences must be 0..1, got {rows[..., 2].min():.3g}..{rows[..., 2].max():.3g}; "
            "the third number of a keypoint is its confidence."
        )
    return Keypoints(names=SETS[rows.shape[1]], uv_px=rows[..., :2].copy(), confidence=np.minimum(rows[..., 2], 1.0))


def write_keypoints(path: Path, keypoints: Keypoints, images: Sequence[str]) -> None:
    """Write keypoints with the names of their images.

    Raises:
        AvatarError: If the file cannot be written.
    """
    rows = np.concatenate([keypoints.uv_px, keypoints.confidence[..., None]], axis=2)
    with write_then_rename(path, raises=AvatarError) as part:
        np.savez(part, allow_pickle=False, keypoints=rows.astype(np.float32), images=np.array(images))


def check_keypoints(keypoints: Keypoints, masks: Iterable[BoolArray], images: Sequence[str], source: Path) -> list[str]:
    """Refuse keypoints that do not show a whole person where the masks do; hints about what is missing.

    Args:
        keypoints: Of F images.
        masks: Where the person is, shape (H, W) each.
        images: Names of the images.
        source: What they are of, for messages.

    Raises:
        AvatarError: If the person, or the feet, are hardly ever seen, or lie outside the masks.
    """
    seen, count = keypoints.seen, len(keypoints)
    empty = np.flatnonzero(seen.sum(axis=1) < _SEEN_MIN)
    if len(empty) > _EMPTY_FRAMES * count:
        raise AvatarError(
            f"{source}: {len(empty)} of {count} frames have fewer than {_SEEN_MIN} keypoints with a confidence of "
            f"{CONFIDENT} or more, {images[empty[0]]} among them; leave out such frames."
        )
    share = {name: float(seen[:, keypoints.column(name)].mean()) for name in keypoints.names}
    if max(share["left_ankle"], share["right_ankle"]) < _FEET_FRAMES_MIN:
        raise AvatarError(
            f"{source}: the ankles are seen in less than {100 * _FEET_FRAMES_MIN:.0f} % of the frames; they tell where "
            "the floor is: record the whole person, from head to feet."
        )
    outside = [frame for frame, mask in enumerate(masks) if _covered_share(mask, keypoints, frame) < _COVER_MIN]
    if len(outside) > _EMPTY_FRAMES * count:
        raise AvatarError(
            f"{source}: in {len(outside)} of {count} frames the mask covers less than {100 * _COVER_MIN:.0f} % of the "
            f"keypoints, {images[outside[0]]} among them: masks and keypoints must be of the same person and images."
        )
    toes = [name for name in keypoints.names if name.endswith(("toe", "heel"))]
    if max((share[name] for name in toes), default=0.0) < _FEET_FRAMES_MIN:
        return ["no keypoints of toes and heels are seen: the directions of the feet are guessed."]
    return []


def _covered_share(mask: BoolArray, keypoints: Keypoints, frame: int) -> float:
    """Share of the seen keypoints of a frame that lie on the mask or near it."""
    uv = np.floor(keypoints.uv_px[frame][keypoints.seen[frame]]).astype(int)
    if not len(uv):
        return 1.0
    rows = np.flatnonzero(mask.any(axis=1))
    reach = 2 * round(_COVER_MARGIN * float(np.ptp(rows))) + 1 if len(rows) else 1
    near = cv2.dilate(mask.astype(np.uint8), np.ones((reach, reach), np.uint8))
    inside = (uv >= 0).all(axis=1) & (uv[:, 0] < mask.shape[1]) & (uv[:, 1] < mask.shape[0])
    return float(near[uv[inside, 1], uv[inside, 0]].sum() / len(uv))


def _rows_of(path: Path, names: list[str], rows: Float64Array, images: Sequence[str]) -> Float64Array:
    """The rows of some images."""
    if len(names) != len(rows):
        raise AvatarError(f"{path} names {len(names)} images, but has keypoints of {len(rows)}.")
    places = {name: number for number, name in enumerate(names)}
    missing = [name for name in images if name not in places]
    if missing:
        raise AvatarError(
            f"{path} lacks the keypoints of {len(missing)} of {len(images)} images, {missing[0]} among them."
        )
    return rows[[places[name] for name in images]]
