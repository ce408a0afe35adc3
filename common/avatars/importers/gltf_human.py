"""Skinned, textured glTF humans as avatars."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from readygo.common.arrays import Float64Array, Int64Array
from readygo.common.avatars.importers.assemble import CanonicalHuman, scale_to_metres
from readygo.common.avatars.importers.gltf_file import GltfFile
from readygo.common.avatars.importers.gltf_paint import paint_part, read_materials
from readygo.common.avatars.importers.gltf_scene import Bones, GltfFigure, GltfPart, read_figure
from readygo.common.avatars.importers.joints import JOINT, rotations_to_tpose
from readygo.common.avatars.importers.report import SkeletonReport
from readygo.common.avatars.importers.skeleton import (
    Mapping24,
    axes_to_smpl,
    joint_of_bones,
    recognise_joints,
    skeleton_report,
    smpl_joints,
)
from readygo.common.avatars.importers.surface import Mesh, gaussians_of_mesh
from readygo.common.errors import AvatarError
from readygo.common.gaussians import GaussianCloud, rgb_of_sh, sh_of_rgb

GAUSSIAN_COUNT = 40_000
_DENSITY = {"head": 4.0, "neck": 2.0, "left_wrist": 2.0, "right_wrist": 2.0, "left_hand": 2.0, "right_hand": 2.0}
"""How much finer than the rest some parts are sampled: where eyes go first."""
_LIGHT_FROM = np.array([0.0, 0.93, 0.37])
"""Textures hold no light; soft daylight from above and in front gives the body its shape."""


def gltf_human(
    path: Path, *, height_m: float | None = None, count: int = GAUSSIAN_COUNT
) -> tuple[CanonicalHuman, SkeletonReport, tuple[str, ...]]:
    """Sample the surface of a skinned figure.

    Args:
        path: .glb, .gltf or .vrm.
        height_m: True height of the human; by default the file's unit is the metre, as glTF says.
        count: Wanted number of Gaussians.

    Returns:
        The human in the file's bind pose, what its bones became, and notes.

    Raises:
        AvatarError: If the file is damaged, has no skin, its bones are not those of a human, or its size is not.
    """
    file = GltfFile(path)
    try:
        with np.errstate(all="ignore"):  # damaged numbers are found by the checks that follow
            figure = read_figure(file)
        materials, notes = read_materials(file, figure.parts)
    except (LookupError, TypeError, ValueError, AttributeError, OverflowError, MemoryError) as error:
        raise AvatarError(f"{path} is not valid glTF ({type(error).__name__}: {error}).") from error
    if not any(len(part.triangles) for part in figure.parts):
        raise AvatarError(f"{path} has no skinned triangles.")
    figure, mapping, scale = _upright(figure, file.extensions, height_m)
    bone_joints = joint_of_bones(mapping, figure.bones)
    toes = {side: _toe(figure, mapping, side) for side in ("left", "right")}
    joints, estimated = smpl_joints(mapping.bone, figure.bones.heads, toes)
    mesh, first = _mesh(figure.parts, bone_joints)

    def paint(triangle: Int64Array, bary: Float64Array) -> Float64Array:
        colours = np.empty((len(triangle), 4))
        for k, part in enumerate(figure.parts):
            mine = (triangle >= first[k]) & (triangle < first[k + 1])
            colours[mine] = paint_part(part, materials[part.material], triangle[mine] - first[k], bary[mine])
        return colours

    try:
        cloud, weights = gaussians_of_mesh(mesh, paint, count)
    except ValueError as error:
        raise AvatarError(f"{path}: {error}") from error
    human = CanonicalHuman(
        cloud=shade_cloud(cloud), weights=weights, joints=joints, R_tpose_canonical=rotations_to_tpose(joints)
    )
    if abs(scale - 1.0) > 1e-6:
        notes = (*notes, f"Lengths of the bind pose were multiplied by {scale:.6g}.")
    return human, skeleton_report(mapping, figure.bones, estimated), notes


def shade_cloud(cloud: GaussianCloud) -> GaussianCloud:
    """The cloud with soft daylight on it; the third axis of each Gaussian is its outward normal."""
    w, x, y, z = cloud.quats_wxyz.astype(np.float64).T
    normals = np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)
    light = 0.82 + 0.20 * (0.5 + 0.5 * normals @ _LIGHT_FROM)
    colour = np.clip(rgb_of_sh(cloud.sh[:, 0]) * light[:, None], 0.0, 1.0)
    return GaussianCloud(
        means_m=cloud.means_m,
        quats_wxyz=cloud.quats_wxyz,
        scales_m=cloud.scales_m,
        opacities=cloud.opacities,
        sh=sh_of_rgb(colour).astype(np.float32)[:, None, :],
    )


def _upright(
    figure: GltfFigure, extensions: Mapping[str, object], height_m: float | None
) -> tuple[GltfFigure, Mapping24, float]:
    """The figure in metres, SMPL axes, soles at y = 0; its joints; the factor on lengths of the bind pose."""
    # Geometry needs to know where up is before joints are known: the longest side of a standing human is its height.
    points = np.concatenate([part.positions[part.triangles.reshape(-1)] for part in figure.parts])
    R_guess, sole = _standing_guess(points, figure.bones)
    heads, turned = figure.bones.heads @ R_guess.T, points @ R_guess.T
    height = float(np.ptp(turned[:, 1]))
    mapping = recognise_joints(figure.bones, extensions, heads - [0.0, sole, 0.0], height)
    R = axes_to_smpl(mapping.bone, figure.bones.heads)
    y = points @ R[1]
    scale = figure.scale * scale_to_metres(float(np.ptp(y)) * figure.scale, height_m)
    shift = np.array([0.0, -float(y.min()) * scale, 0.0])
    return _move_figure(figure, R, scale, shift), mapping, scale


def _standing_guess(points: Float64Array, bones: Bones) -> tuple[Float64Array, float]:
    """A rotation that sets the figure upright, y up and x to its left, and the height of its soles then.

    The skeleton is thinnest from front to back; files have y or z up, and hands and head are in the upper half; the
    soles reach further ahead of the legs' bones than behind them.
    """
    depth = int(np.argmin(np.ptp(bones.heads, axis=0)))
    upright = 1 if depth != 1 else 2
    middle = 0.5 * (points[:, upright].min() + points[:, upright].max())
    up, left = np.zeros(3), np.zeros(3)
    up[upright] = 1.0 if bones.heads[:, upright].mean() >= middle else -1.0
    left[3 - depth - upright] = 1.0
    R: Float64Array = np.stack([left, up, np.cross(left, up)])
    turned = points @ R.T
    sole, height = float(turned[:, 1].min()), float(np.ptp(turned[:, 1]))
    soles = turned[turned[:, 1] <= sole + 0.03 * height, 2]
    heads = bones.heads @ R.T
    legs = heads[(heads[:, 1] > sole + 0.04 * height) & (heads[:, 1] < sole + 0.6 * height), 2]
    ahead = soles.max() + soles.min() - 2 * np.median(legs if len(legs) else soles)
    if ahead < 0.0:
        R = R * np.array([[-1.0], [1.0], [-1.0]])
    return R, sole


def _move_figure(figure: GltfFigure, R: Float64Array, scale: float, shift: Float64Array) -> GltfFigure:
    bones = figure.bones
    parts = tuple(
        GltfPart(
            positions=scale * part.positions @ R.T + shift,
            normals=None if part.normals is None else part.normals @ R.T,
            uv=part.uv,
            colours=part.colours,
            bone_index=part.bone_index,
            bone_weight=part.bone_weight,
            triangles=part.triangles,
            material=part.material,
        )
        for part in figure.parts
    )
    heads = scale * bones.heads @ R.T + shift
    moved = Bones(names=bones.names, nodes=bones.nodes, parents=bones.parents, heads=heads)
    return GltfFigure(bones=moved, parts=parts, scale=1.0)


def _toe(figure: GltfFigure, mapping: Mapping24, side: str) -> Float64Array:
    """Foremost point of the skin that a foot moves; ahead of the ankle by a usual length if it moves none."""
    joints = joint_of_bones(mapping, figure.bones)
    ankle = figure.bones.heads[mapping.bone[f"{side}_ankle"]]
    best: Float64Array = np.array([ankle[0], 0.0, ankle[2] + 1.6 * ankle[1]])
    found = False
    for part in figure.parts:
        moved = np.isin(joints[part.bone_index], (JOINT[f"{side}_ankle"], JOINT[f"{side}_foot"]))
        mine = part.positions[(part.bone_weight * moved).sum(axis=1) > 0.5]
        mine = mine[mine[:, 1] < ankle[1]]
        if len(mine):
            toe = mine[np.argmax(mine[:, 2])]
            if not found or toe[2] > best[2]:
                best, found = toe, True
    return best


def _mesh(parts: Sequence[GltfPart], bone_joints: Int64Array) -> tuple[Mesh, Int64Array]:
    """All parts as one mesh, and the first triangle of each part (and of the end)."""
    corners, normals, weights = [], [], []
    for part in parts:
        dense = np.zeros((len(part.positions), 24))
        rows = np.arange(len(part.positions))
        for column in range(part.bone_index.shape[1]):
            np.add.at(dense, (rows, bone_joints[part.bone_index[:, column]]), part.bone_weight[:, column])
        corner = part.positions[part.triangles]
        corners.append(corner)
        weights.append(dense[part.triangles])
        normals.append(_normals(part, corner))
    density = np.ones(24)
    for joint, factor in _DENSITY.items():
        density[JOINT[joint]] = factor
    all_weights = np.concatenate(weights)
    mesh = Mesh(
        corners_m=np.concatenate(corners),
        normals=np.concatenate(normals),
        weights=all_weights,
        density=all_weights.mean(axis=1) @ density,
    )
    return mesh, np.cumsum([0, *(len(part.triangles) for part in parts)])


def _normals(part: GltfPart, corners: Float64Array) -> Float64Array:
    """Unit normals at the corners: the file's, where they are sound, else those of the triangles."""
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-30)
    flat = np.repeat(flat[:, None], 3, axis=1)
    if part.normals is None:
        return flat
    given = part.normals[part.triangles]
    length = np.linalg.norm(given, axis=2, keepdims=True)
    sound = np.isfinite(given).all(axis=2, keepdims=True) & (length > 1e-12)
    return np.where(sound, given / np.where(sound, length, 1.0), flat)
