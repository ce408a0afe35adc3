"""HumanML3D's motion features: 263 numbers per frame at 20 Hz, relative to where the person is and faces.

| columns | what | unit |
|---|---|---|
| 0 | half the turn of the heading to the next frame, turns to the right positive | rad |
| 1:3 | step of the pelvis to the next frame (x, z), in the heading of the next frame | m |
| 3 | height of the pelvis | m |
| 4:67 | joints 1..21, relative to the point below the pelvis, in the heading | m |
| 67:193 | rotations of joints 1..21, first two columns of the matrix, on HumanML3D's own bone axes | |
| 193:259 | step of all 22 joints to the next frame, in the heading | m |
| 259:263 | contacts: left ankle, left ball, right ankle, right ball | 0 or 1 |

HumanML3D is y-up as SMPL: x left, y up, z forward at heading 0; headings turn left. Frames here are 0.05 s apart, as in
every other module of the animator.

Source: Guo et al., Generating Diverse and Natural 3D Human Motions from Text, CVPR 2022, section 4 and its data.
"""

import itertools
import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import Float64Array
from readygo.common.kernels import kernel_with_cache
from readygo.services.animator.gait.math import wrap

FEATURE_COUNT = 263
JOINT_COUNT = 22
PATH = slice(0, 3)
"""The columns that a ground path determines: what PriorMDM calls root_horizontal."""
HEIGHT = 3
RIC = slice(4, 67)
ROTATIONS = slice(67, 193)
VELOCITIES = slice(193, 259)
CONTACTS = slice(259, 263)
CONTACT_STEP_M2 = 0.002
"""A foot joint whose squared step between two frames is smaller is in contact [m2]."""
HEADING_SIGMA_FRAMES = 20.0
"""HumanML3D smooths the direction that a person faces by this Gaussian before it becomes the heading."""

# Bone axes and chains of HumanML3D's skeleton, on which its rotations are defined.
_AXES = np.zeros((JOINT_COUNT, 3))
_AXES[[1, 13], 0], _AXES[[2, 14], 0] = 1.0, -1.0
_AXES[[3, 6, 9, 12], 1], _AXES[[4, 5, 7, 8, 16, 17, 18, 19, 20, 21], 1] = 1.0, -1.0
_AXES[[10, 11, 15], 2] = 1.0
_CHAINS = ((0, 2, 5, 8, 11), (0, 1, 4, 7, 10), (0, 3, 6, 9, 12, 15), (9, 14, 17, 19, 21), (9, 13, 16, 18, 20))


class Start(NamedTuple):
    """Position and heading at which features begin; the features do not contain them."""

    x_m: float
    z_m: float
    heading_rad: float


@kernel_with_cache
def _encode_path(x: Float64Array, z: Float64Array, psi: Float64Array) -> Float64Array:
    count = len(x) - 1
    features = np.empty((count, 3))
    for t in range(count):
        features[t, 0] = -0.5 * wrap(psi[t + 1] - psi[t])
        c, s = math.cos(psi[t + 1]), math.sin(psi[t + 1])
        dx, dz = x[t + 1] - x[t], z[t + 1] - z[t]
        features[t, 1] = c * dx - s * dz
        features[t, 2] = s * dx + c * dz
    return features


def encode_path(x_m: Float64Array, z_m: Float64Array, heading_rad: Float64Array) -> Float64Array:
    """The columns `PATH` of a ground path.

    Args:
        x_m: y-up world x [m], shape (T + 1,).
        z_m: y-up world z [m], shape (T + 1,).
        heading_rad: 0 faces +z, positive turns left (towards +x), shape (T + 1,).

    Returns:
        Shape (T, 3).
    """
    if not x_m.shape == z_m.shape == heading_rad.shape or x_m.ndim != 1 or len(x_m) < 2:
        raise ValueError(
            f"a path needs x, z and heading of one shape (T + 1,), T >= 1; got {x_m.shape}, {z_m.shape} and "
            f"{heading_rad.shape}."
        )
    return _encode_path(x_m.astype(np.float64), z_m.astype(np.float64), heading_rad.astype(np.float64))


@kernel_with_cache
def _decode_path(features: Float64Array, x: float, z: float, psi: float) -> Float64Array:
    count = len(features)
    path = np.empty((count, 3))
    path[0] = x, z, psi
    for t in range(1, count):
        psi -= 2.0 * features[t - 1, 0]
        c, s = math.cos(psi), math.sin(psi)
        a, b = features[t - 1, 1], features[t - 1, 2]
        x += c * a + s * b
        z += c * b - s * a
        path[t] = x, z, psi
    return path


def decode_path(features: npt.ArrayLike, start: Start) -> Float64Array:
    """Pelvis x [m], z [m] and heading [rad] of every frame of features (T, >= 3), shape (T, 3)."""
    rows = np.ascontiguousarray(np.asarray(features, dtype=np.float64)[:, PATH])
    return _decode_path(rows, float(start.x_m), float(start.z_m), float(start.heading_rad))


@kernel_with_cache
def _decode_joints(features: Float64Array, path: Float64Array) -> Float64Array:
    joints = np.empty((len(features), 22, 3))
    for t in range(len(features)):
        x, z, psi = path[t]
        c, s = math.cos(psi), math.sin(psi)
        joints[t, 0] = x, features[t, 3], z
        for j in range(21):
            a, b = features[t, 4 + 3 * j], features[t, 6 + 3 * j]
            joints[t, j + 1] = x + c * a + s * b, features[t, 5 + 3 * j], z + c * b - s * a
    return joints


def decode_joints(features: npt.ArrayLike, start: Start) -> Float64Array:
    """Joint positions of features ("recover from RIC").

    Args:
        features: Not normalised, shape (T, 263).
        start: Where the first frame is.

    Returns:
        Positions in y-up axes [m], shape (T, 22, 3).
    """
    rows = np.ascontiguousarray(features, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != FEATURE_COUNT or len(rows) == 0:
        raise ValueError(f"features must have shape (T, {FEATURE_COUNT}), T >= 1, got {rows.shape}.")
    return _decode_joints(rows, decode_path(rows, start))


def facing_of(joints_m: Float64Array) -> Float64Array:
    """Heading [rad], unwrapped, of a person with joints (T, >= 18, 3) in y-up axes, shape (T,).

    As in HumanML3D's files (its sample 012314 shows it): the hips count against the shoulders, smoothed over time; only
    the first heading is that of hips and shoulders together, as they are. Their difference is a jump after row 0.
    """
    from scipy.ndimage import gaussian_filter1d

    shoulders, hips = joints_m[:, 17] - joints_m[:, 16], joints_m[:, 2] - joints_m[:, 1]
    across = shoulders - hips
    across /= np.maximum(np.sqrt(np.sum(across * across, axis=1, keepdims=True)), 1e-9)
    across = gaussian_filter1d(across, HEADING_SIGMA_FRAMES, axis=0, mode="nearest")
    across[0] = shoulders[0] + hips[0]
    # The direction faced is the up axis times the direction across: (across_z, -across_x).
    return np.unwrap(np.arctan2(across[:, 2], -across[:, 0]))


def encode(joints_m: npt.ArrayLike) -> tuple[Float64Array, Start]:
    """Features of a motion.

    Args:
        joints_m: Joints 0..21 in y-up axes [m], floor at y = 0, 20 Hz, shape (T + 1, >= 22, 3); more are ignored.

    Returns:
        Features of the first T frames, shape (T, 263), and where they begin.
    """
    joints = np.asarray(joints_m, dtype=np.float64)
    if joints.ndim != 3 or joints.shape[1] < JOINT_COUNT or joints.shape[2] != 3 or len(joints) < 2:
        raise ValueError(f"joints_m must have shape (T + 1, >= {JOINT_COUNT}, 3), T >= 1, got {joints.shape}.")
    joints = joints[:, :JOINT_COUNT]
    psi = facing_of(joints)
    features = np.empty((len(joints) - 1, FEATURE_COUNT))
    features[:, PATH] = encode_path(joints[:, 0, 0], joints[:, 0, 2], psi)
    features[:, HEIGHT] = joints[:-1, 0, 1]
    below = joints[:-1, :1] * (1.0, 0.0, 1.0)
    features[:, RIC] = _turn_vectors(joints[:-1, 1:] - below, psi[:-1]).reshape(-1, 63)
    # HumanML3D's clips begin with heading 0, and shortest ways depend on it.
    turned = _turn_vectors(joints[:-1], np.full(len(psi) - 1, psi[0]))
    features[:, ROTATIONS] = _bone_rotations(turned, psi[:-1] - psi[0])[..., :2].swapaxes(-1, -2).reshape(-1, 126)
    steps = np.diff(joints, axis=0)
    features[:, VELOCITIES] = _turn_vectors(steps, psi[:-1]).reshape(-1, 66)
    features[:, CONTACTS] = np.sum(steps[:, [7, 10, 8, 11]] ** 2, axis=2) < CONTACT_STEP_M2
    return features, Start(float(joints[0, 0, 0]), float(joints[0, 0, 2]), float(psi[0]))


def _turn_vectors(vectors: Float64Array, psi: Float64Array) -> Float64Array:
    """World vectors (T, N, 3) in the headings (T,)."""
    c, s = np.cos(psi)[:, None], np.sin(psi)[:, None]
    x, y, z = np.moveaxis(vectors, -1, 0)
    return np.stack([c * x - s * z, y, s * x + c * z], axis=-1)


def _bone_rotations(joints: Float64Array, psi: Float64Array) -> Float64Array:
    """HumanML3D's parent-relative rotations of joints 1..21, shape (T, 21, 3, 3).

    Every chain begins with the rotation that takes the heading to +z; a joint's rotation then takes its bone's axis to
    the bone by the shortest way, relative to the joint before.
    """
    c, s, zero = np.cos(psi), np.sin(psi), np.zeros_like(psi)
    root = np.stack([c, zero, -s, zero, zero + 1.0, zero, s, zero, c], axis=-1).reshape(-1, 3, 3)
    local = np.empty((len(joints), JOINT_COUNT, 3, 3))
    for chain in _CHAINS:
        before = root
        for parent, joint in itertools.pairwise(chain):
            bone = joints[:, joint] - joints[:, parent]
            bone = bone / np.maximum(np.sqrt(np.sum(bone * bone, axis=1, keepdims=True)), 1e-9)
            aligned = _shortest(_AXES[joint], bone)
            local[:, joint] = before.swapaxes(1, 2) @ aligned
            before = aligned
    return local[:, 1:]


def _shortest(u: Float64Array, v: Float64Array) -> Float64Array:
    """Rotations of the shortest way from a unit vector (3,) to unit vectors (T, 3), shape (T, 3, 3)."""
    w = np.cross(np.broadcast_to(u, v.shape), v)
    K = np.zeros((len(v), 3, 3))
    K[:, 2, 1], K[:, 0, 2], K[:, 1, 0] = w[:, 0], w[:, 1], w[:, 2]
    K[:, 1, 2], K[:, 2, 0], K[:, 0, 1] = -w[:, 0], -w[:, 1], -w[:, 2]
    cosine = np.maximum(v @ u, -1.0 + 1e-9)
    R: Float64Array = np.eye(3) + K + (K @ K) / (1.0 + cosine)[:, None, None]
    return R
