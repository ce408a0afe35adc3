"""CMU mocap in Acclaim files (.asf, .amc) as SMPL joint positions, for tests."""

from pathlib import Path

import numpy as np

METRES = 0.0254 / 0.45
RATE_HZ = 120
# SMPL joint -> CMU bone whose far end is there; None is the root.
BONES = {
    0: None, 1: "lhipjoint", 2: "rhipjoint", 3: "lowerback", 4: "lfemur", 5: "rfemur", 6: "upperback", 7: "ltibia",
    8: "rtibia", 9: "thorax", 10: "lfoot", 11: "rfoot", 12: "lowerneck", 13: None, 14: None, 15: "upperneck",
    16: "lclavicle", 17: "rclavicle", 18: "lhumerus", 19: "rhumerus", 20: "lradius", 21: "rradius",
}  # fmt: skip


def rotation(degrees):
    """Acclaim's XYZ order: about x first, then y, then z, all in fixed axes."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    X = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    Y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    Z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return Z @ Y @ X


def read_skeleton(path: Path):
    """Bones by name (direction * length [m], axis rotation, degrees of freedom) and parents by name."""
    bones, parents, bone = {}, {}, {}
    section = ""
    for line in path.read_text().splitlines():
        words = line.split()
        if not words:
            continue
        if words[0].startswith(":"):
            section = words[0]
        elif section == ":bonedata" and words[0] == "begin":
            bone = {"dof": []}
        elif section == ":bonedata" and words[0] == "end":
            vector = np.array(bone["direction"]) * bone["length"][0] * METRES
            bones[bone["name"]] = vector, rotation(bone["axis"]), bone["dof"]
        elif section == ":bonedata" and words[0] == "name":
            bone["name"] = words[1]
        elif section == ":bonedata" and words[0] == "dof":
            bone["dof"] = words[1:]
        elif section == ":bonedata" and words[0] in ("direction", "length", "axis"):
            bone[words[0]] = [float(word) for word in words[1:4] if word != "XYZ"]
        elif section == ":hierarchy" and words[0] not in ("begin", "end"):
            parents.update(dict.fromkeys(words[1:], words[0]))
    return bones, parents


def read_frames(path: Path):
    """Channel values by bone, one mapping per frame."""
    frames = []
    for line in path.read_text().splitlines():
        words = line.split()
        if len(words) == 1 and words[0].isdigit():
            frames.append({})
        elif frames and len(words) > 1:
            frames[-1][words[0]] = [float(word) for word in words[1:]]
    return frames


def ends_of(bones, parents, frame):
    """Far end of every bone [m], y-up; "root" is the pelvis."""
    root = frame.get("root", [0.0] * 6)
    P, G = {"root": np.array(root[:3]) * METRES}, {"root": rotation(root[3:])}
    for name, parent in parents.items():
        vector, C, dof = bones[name]
        angles = dict(zip(dof, frame.get(name, []), strict=False))
        G[name] = G[parent] @ C @ rotation([angles.get(k, 0.0) for k in ("rx", "ry", "rz")]) @ C.T
        P[name] = P[parent] + G[name] @ vector
    return P


def smpl_joints(ends):
    """Joints 0..21; CMU's clavicles begin at the chest, SMPL's collars a third of the way out and up."""
    P = np.array([ends[BONES[j] or "root"] for j in range(22)])
    for collar, shoulder in ((13, 16), (14, 17)):
        P[collar] = P[9] + 0.35 * (P[shoulder] - P[9])
    return P


def joints_20hz(folder: Path, subject: str, clip: str):
    """SMPL joints of a clip at 20 Hz in y-up axes [m], shape (T, 22, 3), and those of the rest pose, (22, 3)."""
    bones, parents = read_skeleton(folder / f"{subject}.asf")
    frames = read_frames(folder / f"{subject}_{clip}.amc")[:: RATE_HZ // 20]
    motion = np.array([smpl_joints(ends_of(bones, parents, frame)) for frame in frames])
    return motion, smpl_joints(ends_of(bones, parents, {}))
