"""Small humans in the formats that importers read: a body of boxes on a skeleton."""

import json
import pickle
import struct
import sys
import types
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy import sparse

from readygo.common.arrays import Float64Array, Int64Array
from readygo.common.avatars import SMPL_PARENTS
from readygo.common.avatars.importers.joints import JOINT, JOINT_NAMES
from readygo.common.frames import matrix_from_axis_angle

HEIGHT_M = 1.75
_LEFT = {
    "hip": (0.09, 0.92, 0.0), "knee": (0.10, 0.50, 0.0), "ankle": (0.10, 0.08, -0.02), "foot": (0.10, 0.03, 0.12),
    "collar": (0.06, 1.42, 0.0), "shoulder": (0.18, 1.43, 0.0), "elbow": (0.46, 1.43, -0.01),
    "wrist": (0.71, 1.43, -0.01), "hand": (0.80, 1.43, -0.01),
}  # fmt: skip
_MIDDLE = {
    "pelvis": (0, 0.96, 0), "spine1": (0, 1.06, 0), "spine2": (0, 1.17, 0), "spine3": (0, 1.30, 0),
    "neck": (0, 1.48, 0), "head": (0, 1.56, 0.02),
}  # fmt: skip
_BOX_END = {"head": (0.0, HEIGHT_M, 0.02), "left_foot": (0.10, 0.02, 0.19), "left_hand": (0.90, 1.43, -0.01)}
_HALF_WIDTH = {"pelvis": 0.14, "spine1": 0.14, "spine2": 0.15, "spine3": 0.15, "head": 0.08}
_NEXT = {
    "pelvis": "spine1", "spine1": "spine2", "spine2": "spine3", "spine3": "neck", "neck": "head", "hip": "knee",
    "knee": "ankle", "ankle": "foot", "collar": "shoulder", "shoulder": "elbow", "elbow": "wrist", "wrist": "hand",
}  # fmt: skip

MIXAMO = {
    "pelvis": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": "Spine2", "neck": "Neck", "head": "Head",
    **{
        f"{side}_{part}": f"{side.title()}{bone}"
        for side in ("left", "right")
        for part, bone in {
            "hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "foot": "ToeBase", "collar": "Shoulder", "shoulder": "Arm",
            "elbow": "ForeArm", "wrist": "Hand", "hand": "HandMiddle1",
        }.items()
    },
}  # fmt: skip


def tpose_joints_m() -> Float64Array:
    """The joints of the human, shape (24, 3)."""
    place = {joint: np.array(p, dtype=float) for joint, p in _MIDDLE.items()}
    for part, p in _LEFT.items():
        place[f"left_{part}"] = np.array(p)
        place[f"right_{part}"] = np.array(p) * (-1, 1, 1)
    return np.array([place[joint] for joint in JOINT_NAMES])


def lowered_arms(points: Float64Array, angle_rad: float) -> Float64Array:
    """Points of the arms after these are lowered about the shoulders: the A-pose of many figures."""
    lowered = points.copy()
    for sign in (1.0, -1.0):
        shoulder = np.array(_LEFT["shoulder"]) * (sign, 1, 1)
        arm = sign * points[:, 0] > shoulder[0] * sign - 1e-9
        R = matrix_from_axis_angle((0.0, 0.0, -sign * angle_rad))
        lowered[arm] = (points[arm] - shoulder) @ R.T + shoulder
    return lowered


def boxes() -> tuple[Float64Array, Float64Array, Int64Array, Int64Array]:
    """Vertices (V, 3), normals (V, 3), joint of each vertex (V,), triangles (F, 3); the T-pose."""
    joints = tpose_joints_m()
    vertices, normals, owners, triangles = [], [], [], []
    for number, joint in enumerate(JOINT_NAMES):
        side, _, part = joint.rpartition("_")
        following = _NEXT.get(part)
        end = joints[JOINT[f"{side}_{following}" if side and following else following]] if following else None
        if end is None:
            end = np.array(_BOX_END[joint.replace("right", "left")]) * ((-1, 1, 1) if side == "right" else (1, 1, 1))
        half = _HALF_WIDTH.get(part, 0.05 if "spine" not in part else 0.14)
        low = np.minimum(joints[number], end) - half * (np.abs(end - joints[number]) < 0.03 + 0 * end)
        high = np.maximum(joints[number], end) + half * (np.abs(end - joints[number]) < 0.03 + 0 * end)
        if part in ("ankle", "foot"):
            low[1], high[1] = 0.0, max(joints[number][1], 0.06)
            low[0], high[0] = joints[number][0] - 0.04, joints[number][0] + 0.04
        for axis in range(3):
            for sign in (-1.0, 1.0):
                u, v = (axis + 1) % 3, (axis + 2) % 3
                corners = np.tile(low if sign < 0 else high, (4, 1))
                corners[:, u] = np.array([low[u], high[u], high[u], low[u]])
                corners[:, v] = np.array([low[v], low[v], high[v], high[v]])
                normal = np.zeros(3)
                normal[axis] = sign
                first = 4 * len(vertices)
                order = [0, 1, 2, 0, 2, 3] if sign > 0 else [0, 2, 1, 0, 3, 2]
                vertices.append(corners)
                normals.append(np.tile(normal, (4, 1)))
                owners.append(np.full(4, number))
                triangles.append(first + np.array(order).reshape(2, 3))
    return np.concatenate(vertices), np.concatenate(normals), np.concatenate(owners), np.concatenate(triangles)


def smpl_entries(*, betas: int = 2) -> dict[str, Any]:
    """A SMPL model whose skin is the boxes and whose regressor gives the joints; beta 0 makes it 10 % larger."""
    vertices, _, owners, triangles = boxes()
    joints = tpose_joints_m()
    extra = np.concatenate([joints + np.array([0.01, 0, 0]), joints - np.array([0.01, 0, 0])])
    template = np.concatenate([vertices, extra])
    weights = np.eye(24)[np.concatenate([owners, np.tile(np.arange(24), 2)])]
    regressor = np.zeros((24, len(template)))
    for joint in range(24):
        regressor[joint, [len(vertices) + joint, len(vertices) + 24 + joint]] = 0.5
    shapes = np.zeros((len(template), 3, betas))
    shapes[:, :, 0] = 0.1 * template
    parents = SMPL_PARENTS.astype(np.int64).copy()
    parents[0] = 2**32 - 1
    return {
        "v_template": template,
        "shapedirs": shapes,
        "posedirs": np.zeros((len(template), 3, 207)),
        "J_regressor": sparse.csc_matrix(regressor),
        "weights": weights,
        "kintree_table": np.stack([parents, np.arange(24)]),
        "f": triangles.astype(np.uint32),
        "bs_type": "lrotmin",
    }


def write_smpl_npz(path: Path) -> Path:
    entries = smpl_entries()
    entries["J_regressor"] = entries["J_regressor"].toarray()
    np.savez(path, **entries)
    return path


def write_smpl_pickle(path: Path, *, protocol: int = 2, drop: tuple[str, ...] = ()) -> Path:
    """As the old files are: v_template, shapedirs and weights are chumpy arrays."""
    module = types.ModuleType("chumpy.ch")

    class Ch:
        def __init__(self, x: Float64Array) -> None:
            self.x, self.label, self._dirty_vars = x, None, set()

    Ch.__module__, Ch.__qualname__ = "chumpy.ch", "Ch"
    module.Ch = Ch  # type: ignore[attr-defined]
    entries = {key: value for key, value in smpl_entries().items() if key not in drop}
    for key in ("v_template", "shapedirs", "weights"):
        if key in entries:
            entries[key] = Ch(entries[key])
    sys.modules["chumpy"], sys.modules["chumpy.ch"] = types.ModuleType("chumpy"), module
    try:
        path.write_bytes(pickle.dumps(entries, protocol=protocol))
    finally:
        del sys.modules["chumpy"], sys.modules["chumpy.ch"]
    return path


def write_glb(
    path: Path,
    *,
    names: Mapping[str, str] = MIXAMO,
    prefix: str = "mixamorig:",
    lowered_rad: float = 0.0,
    M_world_bind: Float64Array | None = None,
    drop: tuple[str, ...] = (),
    texture: bool = True,
    posed: bool = False,
    foot_share: float = 1.0,
    edit: Any = None,
) -> Path:
    """A skinned human of boxes with 29 bones: upper half of the texture (trunk and arms) red, lower half blue.

    Args:
        path: File to write.
        names: SMPL joint -> bone.
        prefix: Of all bones.
        lowered_rad: How far the arms hang in the bind pose.
        M_world_bind: From the bind pose's axes and unit to glTF's.
        drop: Joints whose bones are left out; their skin goes to the bone above.
        texture: With the texture, otherwise a green base colour.
        posed: The nodes rest in another pose than the bind pose.
        foot_share: How far ahead the feet reach, as a share of the usual length.
        edit: Called with the JSON before it is written.
    """
    M = np.eye(4) if M_world_bind is None else M_world_bind
    joints = lowered_arms(tpose_joints_m(), lowered_rad)
    kept = [number for number, joint in enumerate(JOINT_NAMES) if joint not in drop]
    heads, titles, above = _bones(joints, kept, names)
    vertices, normals, owners, triangles = boxes()
    vertices_before = vertices
    is_arm = np.abs(vertices[:, 0]) > np.array(_LEFT["shoulder"])[0] - 1e-9
    is_arm &= np.isin(
        owners, [JOINT[f"{s}_{p}"] for s in ("left", "right") for p in ("shoulder", "elbow", "wrist", "hand")]
    )
    vertices = np.where(is_arm[:, None], lowered_arms(vertices, lowered_rad), vertices)
    for sign in (1.0, -1.0):
        arm = is_arm & (sign * vertices_before[:, 0] > 0)
        normals[arm] = normals[arm] @ matrix_from_axis_angle((0.0, 0.0, -sign * lowered_rad)).T
    is_toe = np.isin(owners, [JOINT[f"{s}_{p}"] for s in ("left", "right") for p in ("ankle", "foot")])
    vertices[is_toe & (vertices[:, 2] > 0), 2] *= foot_share
    place = {number: k for k, number in enumerate(kept)}
    while not np.isin(owners, kept).all():
        owners = np.where(np.isin(owners, kept), owners, SMPL_PARENTS[owners])
    owner = np.array([place[number] for number in owners])
    lower = np.isin(owners, [JOINT[j] for j in JOINT_NAMES if any(p in j for p in ("hip", "knee", "ankle", "foot"))])
    uv = np.stack([np.full(len(owner), 0.5), np.where(lower, 0.75, 0.25)], axis=1)
    inverse = []
    for head in heads:
        G = np.eye(4)
        G[:3, 3] = head
        inverse.append((np.linalg.inv(G) @ M).T)
    bind = (vertices - M[:3, 3]) @ np.linalg.inv(M[:3, :3]).T
    arrays = [
        (bind.astype("<f4"), "VEC3", 5126),
        ((normals @ M[:3, :3]).astype("<f4"), "VEC3", 5126),
        (uv.astype("<f4"), "VEC2", 5126),
        (np.stack([owner, 0 * owner, 0 * owner, 0 * owner], axis=1).astype("<u1"), "VEC4", 5121),
        (np.tile([1.0, 0, 0, 0], (len(owner), 1)).astype("<f4"), "VEC4", 5126),
        (triangles.reshape(-1, 1).astype("<u2"), "SCALAR", 5123),
        (np.array(inverse).reshape(-1, 16).astype("<f4"), "MAT4", 5126),
    ]
    views, accessors, binary = [], [], b""
    for array, kind, component in arrays:
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": array.nbytes})
        accessors.append({"bufferView": len(views) - 1, "componentType": component, "count": len(array), "type": kind})
        binary += array.tobytes() + b"\0" * (-array.nbytes % 4)
    picture = np.zeros((8, 8, 3), np.uint8)
    picture[:4], picture[4:] = (40, 40, 200), (200, 40, 40)
    png = bytes(cv2.imencode(".png", picture)[1])
    views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(png)})
    binary += png + b"\0" * (-len(png) % 4)
    nodes: list[dict[str, Any]] = [{"name": "Human", "mesh": 0, "skin": 0}]
    for k, title in enumerate(titles):
        local = heads[k] - (heads[above[k]] if above[k] >= 0 else 0)
        nodes.append({"name": prefix + title, "translation": local.tolist()})
        if posed and title == names["left_shoulder"]:
            nodes[-1]["rotation"] = [0.0, 0.0, 0.5, 0.8660254]
    for k, parent in enumerate(above):
        if parent >= 0:
            nodes[parent + 1].setdefault("children", []).append(k + 1)
    colour = {"baseColorTexture": {"index": 0}} if texture else {"baseColorFactor": [0.0, 1.0, 0.0, 1.0]}
    attributes = {"POSITION": 0, "NORMAL": 1, "TEXCOORD_0": 2, "JOINTS_0": 3, "WEIGHTS_0": 4}
    document: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}],
        "nodes": nodes,
        "meshes": [{"primitives": [{"attributes": attributes, "indices": 5, "material": 0}]}],
        "skins": [{"joints": list(range(1, len(titles) + 1)), "inverseBindMatrices": 6}],
        "materials": [{"pbrMetallicRoughness": colour}],
        "textures": [{"source": 0}],
        "images": [{"bufferView": 7, "mimeType": "image/png"}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
    }
    if edit is not None:
        edit(document)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    path.write_bytes(b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks)
    return path


def _bones(
    joints: Float64Array, kept: list[int], names: Mapping[str, str]
) -> tuple[Float64Array, list[str], list[int]]:
    """Heads, names and parents of the kept joints' bones, and of a few that SMPL has not."""
    place = {number: k for k, number in enumerate(kept)}
    above = []
    for number in kept:
        parent = int(SMPL_PARENTS[number])
        while parent >= 0 and parent not in place:
            parent = int(SMPL_PARENTS[parent])
        above.append(place.get(parent, -1))
    heads, titles = [joints[number] for number in kept], [names[JOINT_NAMES[number]] for number in kept]
    extra = [("head", "HeadTop_End", (0, 0.19, 0))]
    for side, sign in (("left", 1.0), ("right", -1.0)):
        extra += [(f"{side}_wrist", f"{side.title()}HandThumb1", (sign * 0.03, 0, 0.03))]
        extra += [(f"{side}_shoulder", f"{side.title()}ArmTwist", (sign * 0.1, 0, 0))]
    for joint, title, offset in extra:
        if JOINT[joint] in place:
            above.append(place[JOINT[joint]])
            heads.append(joints[JOINT[joint]] + offset)
            titles.append(title)
    return np.array(heads), titles, above
