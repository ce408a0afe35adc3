"""A foreign skeleton becomes SMPL's: axes, joints, and who moves the skin of bones that SMPL has not."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float64Array, Int64Array
from readygo.common.avatars.importers.bone_geometry import joints_by_place
from readygo.common.avatars.importers.bone_names import chain_between, joints_by_name, joints_of_humanoid
from readygo.common.avatars.importers.gltf_scene import Bones
from readygo.common.avatars.importers.joints import JOINT, JOINT_NAMES
from readygo.common.avatars.importers.report import SkeletonReport
from readygo.common.errors import AvatarError

ESSENTIAL = (
    "pelvis",
    *(
        f"{side}_{part}"
        for part in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
        for side in ("left", "right")
    ),
)
"""Joints that must have a bone; the others can be estimated."""
_SPINE_SHARES = {"spine1": 0.2, "spine2": 0.4, "spine3": 0.65}
"""Places of the spine's joints between pelvis and neck, for trunks with fewer bones."""
_SPINE_OF_COUNT = {1: ("spine2",), 2: ("spine1", "spine3"), 3: ("spine1", "spine2", "spine3")}
_ANKLE_PER_PELVIS = 0.075
"""Least height of an ankle relative to the pelvis'."""
_AXIS_TOLERANCE = 0.85
"""Cosine between the body's axes and the nearest axes of the file above which the file's are taken."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Mapping24:
    """Bones of SMPL's joints."""

    bone: dict[str, int]
    source: str


def recognise_joints(
    bones: Bones, extensions: Mapping[str, object], up_heads: Float64Array, height: float
) -> Mapping24:
    """Find the bones of SMPL's joints: by a humanoid extension, else by names, else by geometry.

    Args:
        bones: The skeleton.
        extensions: Extensions of the file.
        up_heads: Heads of the bones with y up, soles at 0, shape (B, 3).
        height: Height of the body in the same unit.

    Raises:
        AvatarError: If an essential joint is found by none of them.
    """
    by_name = joints_by_name(bones.names, bones.parents)
    candidates = [
        ("humanoid extension", {**by_name, **joints_of_humanoid(extensions, bones.nodes)} if extensions else {}),
        ("names", by_name),
        ("geometry", joints_by_place(up_heads, bones.parents, height)),
    ]
    if not joints_of_humanoid(extensions, bones.nodes):
        candidates = candidates[1:]
    for source, found in candidates:
        if all(joint in found for joint in ESSENTIAL) and ("head" in found or "neck" in found):
            return Mapping24(bone={**found, **_spine(found, bones.parents)}, source=source)
    named = candidates[-2][1]
    missing = [joint for joint in (*ESSENTIAL, "head") if joint not in named]
    raise AvatarError(
        f"No bone was recognised as {', '.join(missing)}, neither by name nor by place; the file has "
        f"{', '.join(bones.names[:12])}{', ...' if len(bones.names) > 12 else ''}. Rename its bones, as Mixamo's are."
    )


def _spine(found: Mapping[str, int], parents: Int64Array) -> dict[str, int]:
    chain = chain_between(found["pelvis"], found.get("neck", found.get("head", -1)), parents)
    if "neck" not in found and len(chain) > 3:
        chain = chain[:-1]
    if len(chain) > 3:
        chain = [chain[int(k)] for k in np.rint(np.linspace(0, len(chain) - 1, 3))]
    return dict(zip(_SPINE_OF_COUNT.get(len(chain), ()), chain, strict=True))


def axes_to_smpl(bone: Mapping[str, int], heads: Float64Array) -> Float64Array:
    """Rotation from the file's axes to SMPL's (y up, x to the body's left), from where the joints are.

    Files are modelled along axes, so the rotation is the nearest one that permutes axes; a figure that leans more is
    set upright as it is.
    """
    head = heads[bone.get("head", bone.get("neck", -1))]
    feet = 0.5 * (heads[bone["left_ankle"]] + heads[bone["right_ankle"]])
    up = _unit(head - feet)
    left = sum(heads[bone[f"left_{part}"]] - heads[bone[f"right_{part}"]] for part in ("hip", "shoulder"))
    left = _unit(left - (left @ up) * up)
    R: Float64Array = np.stack([left, up, np.cross(left, up)])
    snapped = np.zeros((3, 3))
    for row in (1, 0):
        axis = int(np.argmax(np.abs(R[row]) * (snapped.sum(axis=0) == 0)))
        snapped[row, axis] = np.sign(R[row, axis])
    snapped[2] = np.cross(snapped[0], snapped[1])
    return snapped if (np.einsum("ij,ij->i", R, snapped) > _AXIS_TOLERANCE).all() else R


def smpl_joints(
    bone: Mapping[str, int], heads: Float64Array, toes: Mapping[str, Float64Array]
) -> tuple[Float64Array, tuple[str, ...]]:
    """Places of all 24 joints, and the names of those that had no bone and are estimated.

    Args:
        bone: SMPL joint -> bone.
        heads: Where the bones begin, SMPL axes, soles at y = 0, shape (B, 3).
        toes: Foremost point of each foot, by side.
    """
    place: dict[str, Float64Array] = {joint: heads[number] for joint, number in bone.items()}
    for side in ("left", "right"):
        place[f"{side}_ankle"] = _lift_ankle(place[f"{side}_ankle"], place[f"{side}_knee"], place["pelvis"][1])
    shoulders = 0.5 * (place["left_shoulder"] + place["right_shoulder"])
    if "neck" not in place:
        place["neck"] = shoulders + 0.4 * (place["head"] - shoulders)
    if "head" not in place:
        place["head"] = place["neck"] + 0.6 * (place["neck"] - shoulders)
    for joint, share in _SPINE_SHARES.items():
        place.setdefault(joint, place["pelvis"] + share * (place["neck"] - place["pelvis"]))
    for side in ("left", "right"):
        ankle, wrist = place[f"{side}_ankle"], place[f"{side}_wrist"]
        root = shoulders + 0.25 * (place[f"{side}_shoulder"] - shoulders)
        place.setdefault(f"{side}_collar", root)
        place.setdefault(f"{side}_hand", wrist + 0.33 * (wrist - place[f"{side}_elbow"]))
        place.setdefault(f"{side}_foot", _ball_of_foot(ankle, toes[side]))
    estimated = tuple(joint for joint in JOINT_NAMES if joint not in bone)
    return np.array([place[joint] for joint in JOINT_NAMES]), estimated


def joint_of_bones(mapping: Mapping24, bones: Bones) -> Int64Array:
    """The SMPL joint that moves each bone's skin: its own, its nearest ancestor's, or the pelvis.

    What lies below a wrist is the hand.
    """
    own = {number: JOINT[joint] for joint, number in mapping.bone.items()}
    hands = {JOINT["left_wrist"]: JOINT["left_hand"], JOINT["right_wrist"]: JOINT["right_hand"]}
    joints = np.zeros(len(bones.names), dtype=np.int64)
    for number, parent in enumerate(bones.parents):
        above = int(joints[parent]) if parent >= 0 else JOINT["pelvis"]
        joints[number] = own.get(number, hands.get(above, above))
    return joints


def skeleton_report(mapping: Mapping24, bones: Bones, estimated: tuple[str, ...]) -> SkeletonReport:
    """What was mapped to what."""
    joints = joint_of_bones(mapping, bones)
    used = set(mapping.bone.values())
    order = [joint for joint in JOINT_NAMES if joint in mapping.bone]
    return SkeletonReport(
        bone_of_joint={joint: bones.names[mapping.bone[joint]] for joint in order},
        estimated=estimated,
        merged={name: JOINT_NAMES[joints[k]] for k, name in enumerate(bones.names) if k not in used},
        source=mapping.source,
    )


def _lift_ankle(ankle: Float64Array, knee: Float64Array, pelvis_y: float) -> Float64Array:
    """An ankle's bone that lies on the ground, moved up the shin to where ankles are."""
    least = _ANKLE_PER_PELVIS * pelvis_y
    share = (least - ankle[1]) / (knee[1] - ankle[1]) if ankle[1] < least < knee[1] else 0.0
    lifted: Float64Array = ankle + share * (knee - ankle)
    return lifted


def _ball_of_foot(ankle: Float64Array, toe: Float64Array) -> Float64Array:
    """The joint under the ball of the foot, 0.72 of the way from ankle to toe tip, near the sole."""
    ahead = toe - ankle
    return np.array([ankle[0] + 0.72 * ahead[0], 0.35 * ankle[1], ankle[2] + 0.72 * ahead[2]])


def _unit(vector: Float64Array) -> Float64Array:
    length = float(np.linalg.norm(vector))
    if not length > 0.0:
        raise AvatarError("Head and feet, or left and right, are at the same place: it is no skeleton of a human.")
    unit: Float64Array = vector / length
    return unit
