"""A SMPL body as an avatar in plain clothes: the model has a shape and a skeleton, but no colours."""

import numpy as np

from readygo.common.arrays import Float64Array, Int64Array
from readygo.common.avatars.importers.assemble import CanonicalHuman
from readygo.common.avatars.importers.gltf_human import shade_cloud
from readygo.common.avatars.importers.joints import JOINT
from readygo.common.avatars.importers.smpl_model import SmplModel
from readygo.common.avatars.importers.surface import Mesh, gaussians_of_mesh
from readygo.common.errors import AvatarError

_SKIN, _HAIR, _SHIRT = (0.76, 0.60, 0.50), (0.20, 0.15, 0.12), (0.35, 0.42, 0.50)
_TROUSERS, _SHOES = (0.22, 0.24, 0.30), (0.13, 0.13, 0.14)
_COLOURS = {
    _SKIN: ("neck", "head", "left_elbow", "right_elbow", "left_wrist", "right_wrist", "left_hand", "right_hand"),
    _TROUSERS: ("pelvis", "left_hip", "right_hip", "left_knee", "right_knee"),
    _SHOES: ("left_ankle", "right_ankle", "left_foot", "right_foot"),
}
"""sRGB of the parts that joints move; the rest is the shirt."""


def smpl_human(model: SmplModel, *, count: int) -> tuple[CanonicalHuman, tuple[str, ...]]:
    """Sample the surface of a SMPL body in its zero pose.

    Args:
        model: The body.
        count: Wanted number of Gaussians.

    Returns:
        The human, and notes.

    Raises:
        AvatarError: If the model has no faces.
    """
    if len(model.faces) == 0:
        raise AvatarError("The SMPL model has no faces (f), so that it has no surface to draw.")
    corners = model.vertices_m[model.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    weights = model.weights[model.faces]
    palette = np.tile(np.array(_SHIRT), (24, 1))
    for colour, joints in _COLOURS.items():
        palette[[JOINT[joint] for joint in joints]] = colour
    crown = model.vertices_m[:, 1].max()
    hairline = crown - 0.42 * (crown - model.joints_m[JOINT["head"], 1])
    nape_z = model.joints_m[JOINT["head"], 2]

    def paint(triangle: Int64Array, bary: Float64Array) -> Float64Array:
        blended = np.einsum("mk,mkj->mj", bary, weights[triangle])
        colours = palette[np.argmax(blended, axis=1)]
        points = np.einsum("mk,mki->mi", bary, corners[triangle])
        colours[(points[:, 1] - 0.5 * (points[:, 2] - nape_z)) > hairline] = _HAIR
        return np.concatenate([colours, np.ones((len(triangle), 1))], axis=1)

    mesh = Mesh(
        corners_m=corners,
        normals=np.repeat(normals[:, None], 3, axis=1),
        weights=weights,
        density=np.ones(len(corners)),
    )
    try:
        cloud, skin = gaussians_of_mesh(mesh, paint, count)
    except ValueError as error:
        raise AvatarError(f"The SMPL model cannot be drawn: {error}") from error
    human = CanonicalHuman(
        cloud=shade_cloud(cloud),
        weights=skin,
        joints=model.joints_m,
        R_tpose_canonical=np.tile(np.eye(3), (24, 1, 1)),
        joints_tpose=model.joints_m,
    )
    return human, ("A SMPL model has no colours: the body wears plain clothes.",)
