"""HUGS checkpoints (apple/ml-hugs, `human_*.pth`): decoders run once, the human baked into an avatar.

A checkpoint stores points in SMPL's "da-pose" (legs apart), feature planes, and decoders for appearance, geometry and
skinning; it does not store the body's shape, so a SMPL model file has to come with it.

Source: Kocabas et al., HUGS: Human Gaussian Splats, 2023, and the layout of its released checkpoints.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.avatars.avatar import SMPL_PARENTS
from readygo.common.avatars.importers.assemble import CanonicalHuman
from readygo.common.avatars.importers.joints import JOINT
from readygo.common.avatars.importers.smpl_model import SmplModel
from readygo.common.errors import AvatarError
from readygo.common.extras import install_command
from readygo.common.frames import matrix_from_axis_angle, quat_from_matrix
from readygo.common.gaussians import GaussianCloud

Tensor = Any
State = Mapping[str, Tensor]

CHECKPOINT_KEYS = ("xyz", "scaling_multiplier", "triplane", "appearance_dec", "geometry_dec", "deformation_dec")
_PLANES = ("plane_xy", "plane_xz", "plane_yz")
_PLANE_AXES = ((0, 1), (0, 2), (1, 2))
_LEG_SPREAD_RAD = 1.0
_SKINNING_TEMPERATURE = 0.1
_MIN_SCALE_M = 1e-4
"""The decoder's GELU leaves some scales slightly below 0; they are drawn by their size."""
_MIN_OPACITY = 1.0 / 255.0
"""Fainter Gaussians are never drawn."""


def load_checkpoint(path: str | Path) -> Mapping[str, Any]:
    """Read a checkpoint; only tensors and plain values are loaded.

    Raises:
        AvatarError: If torch is missing, the file is damaged, or it lacks what a HUGS human needs.
    """
    try:
        import torch
    except ImportError as error:
        raise AvatarError(f"HUGS checkpoints need torch; run: {install_command('train')}") from error
    try:
        checkpoint = torch.load(path, map_location="cpu", weights_only=True)
    except FileNotFoundError:
        raise
    except Exception as error:  # torch raises many kinds for damaged files
        line = str(error).strip().split("\n")[0]
        raise AvatarError(f"{path} is not a checkpoint of plain tensors: {line}") from error
    if not isinstance(checkpoint, Mapping):
        raise AvatarError(f"{path} holds a {type(checkpoint).__name__}, not the dictionary of a HUGS checkpoint.")
    missing = [key for key in CHECKPOINT_KEYS if key not in checkpoint]
    if missing:
        raise AvatarError(f"{path} lacks {', '.join(missing)}: it is not a HUGS human checkpoint.")
    return checkpoint


def hugs_human(checkpoint: Mapping[str, Any], model: SmplModel) -> tuple[CanonicalHuman, tuple[str, ...]]:
    """Bake a checkpoint.

    Args:
        checkpoint: From `load_checkpoint`.
        model: The body that the checkpoint was trained with, in its shape.

    Returns:
        The human in the da-pose, which is kept as the canonical pose so that blended skin moves exactly as in HUGS;
        and notes.

    Raises:
        AvatarError: If a tensor is missing or has another shape than HUGS gives it.
    """
    import torch

    with torch.no_grad():
        decoded = decode_human(checkpoint)
        decoded["rotations"] = rotations_of_sixes(decoded.pop("sixes").double())
        baked = {name: _numbers(tensor) for name, tensor in decoded.items()}
    opacities = baked["opacities"]
    kept = opacities >= _MIN_OPACITY
    if not kept.any():
        raise AvatarError("All Gaussians of the checkpoint are transparent; it is not a trained human.")
    scales = np.abs(baked["scales"])
    cloud = GaussianCloud(
        means_m=baked["means"][kept].astype(np.float32),
        quats_wxyz=quat_from_matrix(baked["rotations"][kept]).astype(np.float32),
        scales_m=np.maximum(scales, _MIN_SCALE_M)[kept].astype(np.float32),
        opacities=opacities[kept].astype(np.float32),
        sh=baked["sh"][kept].astype(np.float32),
    )
    notes = []
    if "blendshapes.weight" in checkpoint["deformation_dec"]:
        notes.append("The checkpoint's pose-dependent offsets are left out; avatars bend by skinning alone.")
    if not kept.all():
        notes.append(f"{int((~kept).sum())} transparent Gaussians were dropped.")
    G, P = da_pose(model.joints_m)
    human = CanonicalHuman(
        cloud=cloud,
        weights=baked["weights"][kept],
        joints=P,
        R_tpose_canonical=np.ascontiguousarray(G.transpose(0, 2, 1)),
        joints_tpose=model.joints_m,
    )
    return human, tuple(notes)


def da_pose(joints_tpose: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Global rotations (24, 3, 3) and positions (24, 3) of the joints in the da-pose: hips turned outwards by 1 rad."""
    pose = np.zeros((24, 3))
    pose[JOINT["left_hip"], 2], pose[JOINT["right_hip"], 2] = _LEG_SPREAD_RAD, -_LEG_SPREAD_RAD
    R = matrix_from_axis_angle(pose)
    G, P = R.copy(), joints_tpose.copy()
    for joint in range(1, 24):
        parent = int(SMPL_PARENTS[joint])
        G[joint] = G[parent] @ R[joint]
        P[joint] = P[parent] + G[parent] @ (joints_tpose[joint] - joints_tpose[parent])
    return G, P


def decode_human(checkpoint: Mapping[str, Any]) -> dict[str, Tensor]:
    """What the decoders make of the points, in the da-pose; differentiable by all tensors of the checkpoint.

    Returns:
        `means` (N, 3) and `scales` (N, 3) [m], which may be slightly negative; `sixes` (N, 6), see
        `rotations_of_sixes`; `opacities` (N,); `sh` (N, K, 3); `weights` of the joints (N, 24).

    Raises:
        AvatarError: If a tensor is missing, has another shape than HUGS gives it, or is not finite.
    """
    xyz = _tensor(checkpoint, "xyz", (None, 3))
    features = _features(_tensors_of(checkpoint, "triplane"), xyz)
    width = features.shape[1]
    appearance = _Decoder(checkpoint, "appearance_dec", width)
    geometry = _Decoder(checkpoint, "geometry_dec", width)
    hidden_a, hidden_g = appearance.hidden_layers(features), geometry.hidden_layers(features)
    multiplier = _tensor(checkpoint, "scaling_multiplier", (len(xyz), 1))
    degree = _sh_degree(checkpoint)
    sh = appearance.linear("shs", hidden_a, 48).reshape(-1, 16, 3)[:, : (min(max(degree, 0), 3) + 1) ** 2]
    return {
        "means": xyz + geometry.linear("xyz.1", hidden_g, 3),
        "scales": _gelu(geometry.linear("scales.1", hidden_g, 3)) * multiplier,
        "sixes": geometry.linear("rotations.1", hidden_g, 6),
        "opacities": appearance.linear("opacity.0", hidden_a, 1).sigmoid()[:, 0],
        "sh": sh,
        "weights": _skinning(checkpoint, features),
    }


def _skinning(checkpoint: Mapping[str, Any], features: Tensor) -> Tensor:
    decoder = _Decoder(checkpoint, "deformation_dec", features.shape[1])
    h = decoder.hidden_layers(features)
    h = _gelu(
        h @ decoder.layer_weight("skinning_linear", h.shape[1]).T + decoder.tensor("skinning_linear.bias", (None,))
    )
    return (_gelu(decoder.linear("skinning", h, 24)) / _SKINNING_TEMPERATURE).softmax(dim=-1)


def _features(planes: State, xyz: Tensor) -> Tensor:
    """Features of points in [-1, 1]^3, bilinear, concatenated over the three planes, shape (N, 3 F)."""
    import torch
    from torch.nn.functional import grid_sample

    if not bool((xyz.abs() <= 1.002).all()):
        raise AvatarError("xyz must lie in -1..1, where HUGS' feature planes are; the checkpoint is of another model.")
    parts = []
    for key, axes in zip(_PLANES, _PLANE_AXES, strict=True):
        plane = _tensor(planes, key, (1, None, None, None), "triplane.")
        if not plane.numel():
            raise AvatarError(f"triplane.{key} of the checkpoint is empty, got {tuple(plane.shape)}.")
        grid = xyz[None, :, None, list(axes)]
        parts.append(grid_sample(plane, grid, mode="bilinear", padding_mode="zeros", align_corners=True)[0, :, :, 0].T)
    return torch.cat(parts, dim=1)


class _Decoder:
    """One small network of the checkpoint."""

    def __init__(self, checkpoint: Mapping[str, Any], name: str, width: int) -> None:
        self.state, self.prefix, self.width = _tensors_of(checkpoint, name), f"{name}.", width

    def tensor(self, key: str, shape: tuple[int | None, ...]) -> Tensor:
        return _tensor(self.state, key, shape, self.prefix)

    def linear(self, key: str, x: Tensor, outputs: int | None) -> Tensor:
        weight = self.tensor(f"{key}.weight", (outputs, x.shape[1]))
        return x @ weight.T + self.tensor(f"{key}.bias", (weight.shape[0],))

    def hidden_layers(self, features: Tensor) -> Tensor:
        return _gelu(self.linear("net.2", _gelu(self.linear("net.0", features, None)), None))

    def layer_weight(self, key: str, width: int) -> Tensor:
        """The matrix of a layer with weight normalisation, g v / |v| by rows, or a plain one."""
        if f"{key}.weight" in self.state:
            return self.tensor(f"{key}.weight", (None, width))
        names = (f"{key}.weight_g", f"{key}.weight_v")
        if f"{key}.parametrizations.weight.original0" in self.state:
            names = (f"{key}.parametrizations.weight.original0", f"{key}.parametrizations.weight.original1")
        v = self.tensor(names[1], (None, width))
        return self.tensor(names[0], (v.shape[0], 1)) * v / v.norm(dim=1, keepdim=True)


def _tensors_of(checkpoint: Mapping[str, Any], name: str) -> State:
    """A part of a checkpoint that must be a dictionary of tensors."""
    if not isinstance(checkpoint[name], Mapping):
        raise AvatarError(f"{name} of the checkpoint must be a dictionary of tensors.")
    part: State = checkpoint[name]
    return part


def _sh_degree(checkpoint: Mapping[str, Any]) -> int:
    """Degree of the harmonics that were in use; 0 if the checkpoint names none."""
    try:
        return int(checkpoint.get("active_sh_degree", 0))
    except (TypeError, ValueError, OverflowError, RuntimeError) as error:
        raise AvatarError("active_sh_degree of the checkpoint must be a whole number.") from error


def _tensor(state: Mapping[str, Any], key: str, shape: tuple[int | None, ...], prefix: str = "") -> Tensor:
    import torch

    if key not in state:
        raise AvatarError(f"The checkpoint lacks {prefix}{key}: it is not of the HUGS model this importer knows.")
    value = state[key]
    if not isinstance(value, torch.Tensor):
        raise AvatarError(f"{prefix}{key} of the checkpoint must be a tensor, got {type(value).__name__}.")
    fits = value.ndim == len(shape) and all(want in (None, got) for want, got in zip(shape, value.shape, strict=True))
    if not fits:
        text = " x ".join("any" if size is None else str(size) for size in shape)
        raise AvatarError(f"{prefix}{key} of the checkpoint must be {text}, got {tuple(value.shape)}.")
    value = value.float()
    if not bool(value.isfinite().all()):
        raise AvatarError(f"{prefix}{key} of the checkpoint holds values that are not finite.")
    return value


def _gelu(x: Tensor) -> Tensor:
    from torch.nn.functional import gelu

    return gelu(x)


def rotations_of_sixes(sixes: Tensor) -> Tensor:
    """Rotation matrices of two rows each, orthonormalised, shape (N, 6) -> (N, 3, 3).

    Source: Zhou et al., On the Continuity of Rotation Representations in Neural Networks, 2019.
    """
    import torch

    first, second = sixes[:, :3], sixes[:, 3:]
    a = first / first.norm(dim=1, keepdim=True).clamp(min=1e-12)
    b = second - (a * second).sum(dim=1, keepdim=True) * a
    b = b / b.norm(dim=1, keepdim=True).clamp(min=1e-12)
    return torch.stack([a, b, torch.linalg.cross(a, b)], dim=1)


def _numbers(tensor: Tensor) -> Float64Array:
    numbers: Float64Array = tensor.detach().numpy().astype(np.float64)
    return numbers
