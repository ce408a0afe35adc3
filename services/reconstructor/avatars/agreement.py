"""Do poses, masks and cameras belong together, and do the masks show the feet? Checked before any fit."""

import dataclasses
import math

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array, Int64Array
from readygo.common.avatars import Avatar, joint_positions
from readygo.common.errors import AvatarError
from readygo.common.messages import Motion
from readygo.common.rasterizer.packed.avatar import pack_avatar
from readygo.services.reconstructor.avatars.body import (
    OVERLAP_MIN,
    overlap_of,
    silhouette,
    some_frames,
    swap_sides,
)
from readygo.services.reconstructor.avatars.views import FilmedPerson, PersonView, view_at

SWAPPED_GAIN = 0.05
"""Poses with left and right exchanged fit the masks better by so much: the sides are swapped."""
SHIFTED_GAIN = 0.1
"""Masks of other frames fit the poses better by so much: they are not of the same frames. In a walk of 16 frames, masks
of 8 frames later have a common share of 0.58, those of their frames 0.81."""
SHIFTED_MIN = 0.6
"""... and have at least this share of their union in common, as poses and masks of one frame do."""
JOINTS_GAIN, JOINTS_MIN = 0.2, 0.8
"""The same of poses of other frames, where the camera moves: shares of their joints that the masks cover."""
_SHIFT_PAIRS_MIN = 3
_FRACTION = 2
LEGS_MIN = 0.85
"""Masks with a smaller share of the legs' length have no feet. Of m1_casual and f2_office with errors of 3 degrees and
2 cm, frames show 0.88 to 1.09 with feet, and 0.61 to 0.79 without the lowest 15 % of the masks."""
_ENDS = (0.005, 0.995)
"""Shares of a silhouette's pixels between its ends: single pixels beyond do not count."""
_HEAD = 15
_FOOTLESS_FRAMES, _NOTED_FRAMES = 0.5, 0.25
"""Shares of frames without feet that are too many, and that are noted: errors of poses alone make them one in six."""


def check_agreement(
    body: Avatar, overlap: float, person: FilmedPerson, pose: Float64Array, root_m: Float64Array
) -> list[str]:
    """Refuse poses that do not fit the masks, and masks without feet; hints about feet that are not always seen.

    Args:
        body: Body at the person's size.
        overlap: Common share of its silhouettes and the masks.
        person: The film.
        pose: Poses [rad], shape (F, 24, 3).
        root_m: Pelvises [m], shape (F, 3).

    Raises:
        AvatarError: If sides are swapped, masks are those of other frames or do not fit, or hardly ever show feet.
    """
    swapped = overlap_of(body, person, swap_sides(pose), root_m)
    _check_shift(body, person, pose, root_m, swapped)
    if swapped > overlap + SWAPPED_GAIN:
        raise AvatarError(
            f"The poses fit the masks better with left and right exchanged ({swapped:.2f} of their union instead of "
            f"{overlap:.2f}): the sides of the joints are swapped."
        )
    if overlap < OVERLAP_MIN:
        raise AvatarError(
            f"Poses and masks have {overlap:.2f} of their union in common, at least {OVERLAP_MIN} are needed: look at "
            "the cameras, the scale, and the order of poses and images."
        )
    return _check_feet(body, person, pose, root_m)


def _check_shift(
    body: Avatar, person: FilmedPerson, pose: Float64Array, root_m: Float64Array, otherwise: float
) -> None:
    """Refuse masks or poses of other frames, which fit clearly better, and masks better than `otherwise`."""
    frames = np.array(some_frames(person))
    best, found, instead = _best_shift(*_overlaps(body, person, frames, pose, root_m), frames)
    if found > max(instead + SHIFTED_GAIN, SHIFTED_MIN, otherwise):
        raise AvatarError(
            f"The masks of {_words(best)} fit the poses better ({found:.2f} of their union instead of {instead:.2f}): "
            "images, masks, poses and cameras must be of the same frames."
        )
    covered = _covered_joints(body, person, frames, pose, root_m)
    best, found, instead = _best_shift(covered, np.full_like(covered, pose.shape[1]), frames)
    if found > max(instead + JOINTS_GAIN, JOINTS_MIN):
        raise AvatarError(
            f"The poses of about {_words(best)} fit the masks better ({found:.0%} of the joints lie in the masks "
            f"instead of {instead:.0%}): images, masks, poses and cameras must be of the same frames."
        )


def _best_shift(part: Int64Array, whole: Int64Array, frames: Int64Array) -> tuple[int, float, float]:
    """The shift of frames with the largest gain, the share that is common then, and without it in the same frames.

    Args:
        part: What N frames have in common with each of F, shape (N, F).
        whole: All that could be, shape (N, F).
        frames: Numbers of the N frames, shape (N,).
    """
    rows, count = np.arange(len(frames)), part.shape[1]
    best, found, instead = 0, 0.0, 0.0
    for shift in range(1 - count, count):
        there = rows[(frames + shift >= 0) & (frames + shift < count)]
        if len(there) >= min(_SHIFT_PAIRS_MIN, len(frames)):
            own, other = (
                float(part[there, columns].sum() / max(whole[there, columns].sum(), 1))
                for columns in (frames[there], frames[there] + shift)
            )
            if other - own > found - instead:
                best, found, instead = shift, other, own
    return best, found, instead


def _words(shift: int) -> str:
    return f"{abs(shift)} frames {'later' if shift > 0 else 'earlier'}"


def _covered_joints(
    body: Avatar, person: FilmedPerson, frames: Int64Array, pose: Float64Array, root_m: Float64Array
) -> Int64Array:
    """How many joints of each pose the masks of some frames cover, as their cameras see them, shape (N, F)."""
    counts = np.empty((len(frames), len(person)), dtype=np.int64)
    for row, number in enumerate(frames):
        view = view_at(person, number, _FRACTION)
        mask = view.mask > 0.5
        joints = np.floor(_project(body, view, pose, root_m)).astype(int)
        inside: BoolArray = np.all((joints >= 0) & (joints < mask.shape[::-1]), axis=2)
        columns, rows = np.where(inside[..., None], joints, 0).transpose(2, 0, 1)
        counts[row] = (inside & mask[rows, columns]).sum(axis=1)
    return counts


def _overlaps(
    body: Avatar, person: FilmedPerson, frames: Int64Array, pose: Float64Array, root_m: Float64Array
) -> tuple[Int64Array, Int64Array]:
    """Pixels that bodies of some frames and masks of all frames have in common, and those of either.

    A body is drawn as its frame's camera sees it, and compared with each mask where that lies in its image.

    Returns:
        Two counts, shape (N, F) each.
    """
    views = [view_at(person, number, _FRACTION) for number in range(len(person))]
    # Where cut-outs lie relative to the principal point.
    lefts = np.array([-view.K_px[:2, 2] for view in views])
    ends = lefts + [view.mask.shape[::-1] for view in views]
    origin = lefts.min(axis=0)
    width, height = (math.ceil(side) + 1 for side in ends.max(axis=0) - origin)
    packed, drawn = pack_avatar(body), []
    for number in frames:
        K = views[number].K_px.copy()
        K[:2, 2] = -origin
        whole = dataclasses.replace(views[number], mask=np.zeros((height, width), dtype=np.float32), K_px=K)
        drawn.append(silhouette(body, packed, whole, pose[number], root_m[number]))
    areas = np.array([each.sum() for each in drawn])
    both, either = (np.empty((len(frames), len(views)), dtype=np.int64) for _ in range(2))
    for number, (view, (left, top)) in enumerate(zip(views, np.rint(lefts - origin).astype(int), strict=True)):
        mask = view.mask > 0.5
        rows, columns = slice(top, top + mask.shape[0]), slice(left, left + mask.shape[1])
        both[:, number] = [(each[rows, columns] & mask).sum() for each in drawn]
        either[:, number] = areas + mask.sum() - both[:, number]
    return both, either


def _check_feet(body: Avatar, person: FilmedPerson, pose: Float64Array, root_m: Float64Array) -> list[str]:
    """Refuse masks that hardly ever show feet; a hint if some do not.

    Without feet a whole silhouette looks like that of a smaller person. So what it shows below the pelvis is compared
    with what it shows above, where the pelvis is by the poses.
    """
    packed, legs = pack_avatar(body), []
    frames = some_frames(person)
    for frame in frames:
        view = view_at(person, frame, _FRACTION)
        pelvis, head = _project(body, view, pose[frame][None], root_m[frame][None])[0, [0, _HEAD]]
        up = (head - pelvis) / max(float(np.linalg.norm(head - pelvis)), 1e-9)
        drawn = silhouette(body, packed, view, pose[frame], root_m[frame])
        legs.append(_legs_share(view.mask > 0.5, pelvis, up) / max(_legs_share(drawn, pelvis, up), 1e-9))
    hidden = int(np.sum(np.array(legs) < LEGS_MIN))
    if hidden > _FOOTLESS_FRAMES * len(frames):
        raise AvatarError(
            f"In {hidden} of {len(frames)} frames that were looked at the masks end above the feet: they show "
            f"{np.median(legs):.0%} of the legs' length. Without feet no one can walk, and the height is not known: "
            "record the whole person, and give masks with the feet."
        )
    if hidden <= _NOTED_FRAMES * len(frames):
        return []
    return [f"the masks end above the feet in {hidden} of {len(frames)} frames that were looked at."]


def _legs_share(mask: BoolArray, pelvis_px: Float64Array, up: Float64Array) -> float:
    """How far a silhouette reaches below the pelvis, relative to how far above it; 0 where it is on one side."""
    rows, columns = np.nonzero(mask)
    if not len(rows):
        return 0.0
    low, high = np.quantile((np.stack([columns, rows], axis=1) + 0.5 - pelvis_px) @ up, _ENDS)
    return float(max(-low, 0.0) / high) if high > 0.0 else 0.0


def _project(body: Avatar, view: PersonView, pose: Float64Array, root_m: Float64Array) -> Float64Array:
    """Pixels of the joints of N poses in a view, shape (N, 24, 2)."""
    motion = Motion(root_m=root_m.astype(np.float32), pose_axis_angle=pose.astype(np.float32))
    T = view.T_world_camera
    seen = (joint_positions(body, motion) - T[:3, 3]) @ T[:3, :3] @ view.K_px.T
    pixels: Float64Array = seen[..., :2] / np.maximum(seen[..., 2:], 1e-6)
    return pixels
