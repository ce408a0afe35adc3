"""CMU mocap in Acclaim files (.asf, .amc) as joint positions and bone rotations.

The data are free for all uses (mocap.cs.cmu.edu, NSF EIA-0196217); y up, x left, z forward in the rest pose.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from readygo.common.arrays import Float64Array

Frame = dict[str, list[float]]

METRES = 0.0254 / 0.45
RATE_HZ = 120
# SMPL joint -> CMU bone whose far end is there; None is the root.
BONES: dict[int, str | None] = {
    0: None, 1: "lhipjoint", 2: "rhipjoint", 3: "lowerback", 4: "lfemur", 5: "rfemur", 6: "upperback", 7: "ltibia",
    8: "rtibia", 9: "thorax", 10: "lfoot", 11: "rfoot", 12: "lowerneck", 13: None, 14: None, 15: "upperneck",
    16: "lclavicle", 17: "rclavicle", 18: "lhumerus", 19: "rhumerus", 20: "lradius", 21: "rradius",
}  # fmt: skip


class Bone(NamedTuple):
    """One bone of an Acclaim skeleton."""

    vector_m: Float64Array
    """Vector from its near to its far end in the rest pose [m], shape (3,)."""
    R_axis: Float64Array
    """Axes of its angles, shape (3, 3)."""
    dof: list[str]
    """Its angles, of rx, ry and rz."""


def rotation(degrees: list[float]) -> Float64Array:
    """Acclaim's XYZ order: about x first, then y, then z, all in fixed axes."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    X = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    Y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    Z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    R: Float64Array = Z @ Y @ X
    return R


def read_skeleton(path: Path) -> tuple[dict[str, Bone], dict[str, str]]:
    """Bones by name, and parents by name in an order that has parents first."""
    bones: dict[str, Bone] = {}
    parents: dict[str, str] = {}
    section, name, numbers, dof = "", "", {}, []
    for line in path.read_text().splitlines():
        words = line.split()
        if not words:
            continue
        if words[0].startswith(":"):
            section = words[0]
        elif section == ":bonedata" and words[0] == "begin":
            numbers, dof = {}, []
        elif section == ":bonedata" and words[0] == "end":
            vector = np.array(numbers["direction"]) * numbers["length"][0] * METRES
            bones[name] = Bone(vector, rotation(numbers["axis"]), dof)
        elif section == ":bonedata" and words[0] == "name":
            name = words[1]
        elif section == ":bonedata" and words[0] == "dof":
            dof = words[1:]
        elif section == ":bonedata" and words[0] in ("direction", "length", "axis"):
            numbers[words[0]] = [float(word) for word in words[1:4] if word != "XYZ"]
        elif section == ":hierarchy" and words[0] not in ("begin", "end"):
            parents.update(dict.fromkeys(words[1:], words[0]))
    return bones, parents


def read_frames(path: Path) -> list[Frame]:
    """Channel values by bone, one mapping per frame."""
    frames: list[Frame] = []
    for line in path.read_text().splitlines():
        words = line.split()
        if len(words) == 1 and words[0].isdigit():
            frames.append({})
        elif frames and len(words) > 1:
            frames[-1][words[0]] = [float(word) for word in words[1:]]
    return frames


def pose_of(
    bones: dict[str, Bone], parents: dict[str, str], frame: Frame
) -> tuple[dict[str, Float64Array], dict[str, Float64Array]]:
    """Far end of every bone [m] and its global rotation, y-up; "root" is the pelvis."""
    root = frame.get("root", [0.0] * 6)
    P, G = {"root": np.array(root[:3]) * METRES}, {"root": rotation(root[3:])}
    for name, parent in parents.items():
        vector, C, dof = bones[name]
        angles = dict(zip(dof, frame.get(name, []), strict=False))
        G[name] = G[parent] @ C @ rotation([angles.get(k, 0.0) for k in ("rx", "ry", "rz")]) @ C.T
        P[name] = P[parent] + G[name] @ vector
    return P, G


def smpl_joints(ends: dict[str, Float64Array]) -> Float64Array:
    """Joints 0..21; CMU's clavicles begin at the chest, SMPL's collars a third of the way out and up."""
    P = np.array([ends[BONES[j] or "root"] for j in range(22)])
    for collar, shoulder in ((13, 16), (14, 17)):
        P[collar] = P[9] + 0.35 * (P[shoulder] - P[9])
    return P


def read_clip(folder: Path, clip: str) -> tuple[Float64Array, dict[str, Float64Array]]:
    """Joints and bone rotations of a clip at 120 Hz.

    Args:
        folder: Where the .asf and .amc files are.
        clip: Subject and number, as "02_01".

    Returns:
        SMPL joints [m], shape (T, 22, 3), and global rotations of all bones by name, each (T, 3, 3).
    """
    bones, parents = read_skeleton(folder / f"{clip.split('_')[0]}.asf")
    poses = [pose_of(bones, parents, frame) for frame in read_frames(folder / f"{clip}.amc")]
    joints = np.array([smpl_joints(P) for P, _ in poses])
    return joints, {name: np.array([G[name] for _, G in poses]) for name in poses[0][1]}


def joints_20hz(folder: Path, subject: str, clip: str) -> tuple[Float64Array, Float64Array]:
    """SMPL joints of a clip at 20 Hz in y-up axes [m], shape (T, 22, 3), and those of the rest pose, (22, 3)."""
    bones, parents = read_skeleton(folder / f"{subject}.asf")
    rest, _ = pose_of(bones, parents, {})
    motion, _ = read_clip(folder, f"{subject}_{clip}")
    return motion[:: RATE_HZ // 20], smpl_joints(rest)
