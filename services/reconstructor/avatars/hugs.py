"""A person as HUGS represents one: points in the da-pose, feature planes, and decoders for looks, shape and skinning.

Everything that is learned lies in one dictionary with the layout of HUGS' checkpoints, which
`readygo.common.avatars.importers.hugs` decodes, here and on import. The decoders first learn the body, then the person.
Points stay as many as they are.

Source: Kocabas et al., HUGS: Human Gaussian Splats, 2023, and the layout of its released checkpoints.
"""

import dataclasses
import math
from typing import Any

import numpy as np
import torch
from torch.nn.functional import interpolate

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.avatars import Avatar
from readygo.common.avatars.importers.assemble import strongest_four
from readygo.common.avatars.importers.hugs import da_pose, decode_human, rotations_of_sixes
from readygo.common.avatars.posing import nearest_rotation
from readygo.common.avatars.torch_posing import nearest_quat, quat_multiply
from readygo.common.errors import AvatarError
from readygo.common.frames import quat_from_matrix
from readygo.common.frames import quat_multiply as multiply_quats
from readygo.services.reconstructor.avatars.config import AvatarFitConfig
from readygo.services.reconstructor.avatars.fit import (
    LENGTHS_UNTIL,
    RIG_RATES,
    BoundGaussians,
    PersonFit,
    between,
    needle_loss,
    person_feature,
)
from readygo.services.reconstructor.avatars.rig import BoneLengths
from readygo.services.reconstructor.avatars.surroundings import Surroundings
from readygo.services.reconstructor.avatars.trajectory import PoseTrajectory
from readygo.services.reconstructor.avatars.views import FilmedPerson, PersonView
from readygo.services.reconstructor.differentiable.autograd import Rendered, rasterize
from readygo.services.reconstructor.training.parameters import Gaussians

Tensor = torch.Tensor
FEATURES, PLANE_SIDE = 32, 256
_CELLS, _FEATURE_SIGMA = 12, 0.5
"""Planes begin as smooth random functions, bicubic between so many values along a side; decoders learn the body from
these far sooner than from white noise."""
_HIDDEN = {"appearance_dec": 64, "geometry_dec": 128, "deformation_dec": 128}
_RATES = {"xyz": 1e-4, "triplane": 8e-3, "appearance_dec": 4e-3, "geometry_dec": 2e-3, "deformation_dec": 8e-4}
"""Learning rates; at the end a tenth of it."""
_WARM_SHARE, _WARM_MAX = 0.15, 400
"""The decoders learn the body in this share of the steps, at most in so many."""
_WEIGHTS_PULL, _OFFSET_PULL = 30.0, 2.0
"""Weights of the mean squared difference from the body's skinning weights, and of offsets [1/m2]."""
_GELU_ONE = 1.1446
"""GELU's value here is 1."""
_SCALE_MIN_M = 1e-4


class HugsFit(PersonFit):
    """A fit of feature planes and decoders under way; `bound` is what they come to at the end."""

    def __init__(
        self,
        body: Avatar,
        person: FilmedPerson,
        trajectory: PoseTrajectory,
        config: AvatarFitConfig,
        likely: BoneLengths | None = None,
        *,
        pelvis_m: Float64Array,
        fixed_lengths: bool,
        surroundings: Surroundings | None = None,
    ) -> None:
        """Begin on a body.

        Args:
            body: The first body.
            person: The film.
            trajectory: How the person moved.
            config: How.
            likely: The likeliest lengths of bones; None takes the body's.
            pelvis_m: Where SMPL's frame has the body's pelvis in the T-pose [m], shape (3,).
            fixed_lengths: True keeps the body's proportions, as checkpoints have none.
            surroundings: The scene, which is then drawn with the person, and learned.

        Raises:
            AvatarError: If the body is beyond the feature planes.
        """
        thin = _thin(spread_body(body, pelvis_m), config.hugs_points)
        super().__init__(thin, person, trajectory, config, likely, surroundings)
        self._fixed = fixed_lengths
        values = self.bound.gaussians.values
        if np.abs(values["means_m"]).max() > 1.0:
            raise AvatarError("The body reaches beyond 1 m from SMPL's origin, where HUGS' feature planes end.")
        weights = np.zeros((len(self), 24), dtype=np.float32)
        np.put_along_axis(weights, self.bound.joint.astype(np.int64), self.bound.weight, axis=1)
        self._body_weights, self._body_sh = torch.from_numpy(weights), torch.from_numpy(values["sh"].copy())
        self._body_opacity = torch.from_numpy(self.bound.gaussians.opacities.copy())
        sizes = np.exp(np.sort(values["log_scales"], axis=1)[:, 1:].mean(axis=1, keepdims=True))
        self.checkpoint = new_checkpoint(values["means_m"], sizes, config.seed)
        self._warm = min(_WARM_MAX, round(_WARM_SHARE * config.steps))
        groups = [
            {"params": list(_tensors({name: self.checkpoint[name]}).values()), "lr": rate}
            for name, rate in _RATES.items()
        ]
        self._optimiser = torch.optim.Adam(groups)
        for tensor in _tensors(self.checkpoint).values():
            moments = {part: torch.zeros_like(tensor) for part in ("exp_avg", "exp_avg_sq")}
            self._optimiser.state[tensor] = {"step": torch.tensor(0.0), **moments}

    def __len__(self) -> int:
        return len(self.bound.gaussians)

    def state(self) -> dict[str, Float32Array]:
        """All arrays by name, for a checkpoint of the fit."""
        arrays = dict(self.rig.state())
        if self.surroundings is not None:
            arrays |= self.surroundings.state()  # type: ignore[arg-type]
        for name, tensor in _tensors(self.checkpoint).items():
            arrays[name] = tensor.detach().numpy()  # type: ignore[assignment]
            arrays |= {f"{name} {part}": value.numpy() for part, value in self._optimiser.state[tensor].items()}
        return arrays  # type: ignore[return-value]

    def load(self, step: int, state: dict[str, Float32Array]) -> None:
        """Continue at a step with what `state` gave."""
        self.step = step
        self.rig.load(state)  # type: ignore[arg-type]
        if self.surroundings is not None:
            self.surroundings.load(state)
        for name, tensor in _tensors(self.checkpoint).items():
            tensor.data.copy_(torch.from_numpy(state[name]))
            for part, value in self._optimiser.state[tensor].items():
                value.copy_(torch.from_numpy(np.asarray(state[f"{name} {part}"])))
        self._bake()

    def one_step(self) -> None:
        """Learn the body; or draw a frame, and change what it has a gradient of; if held out, the motion alone."""
        share = self.step / self.config.steps
        for group, rate in zip(self._optimiser.param_groups, _RATES.values(), strict=True):
            group["lr"] = between((rate, 0.1 * rate), share)
        self._optimiser.zero_grad()
        if self.step < self._warm:
            self._learn_body()
        elif not self._learn_frame(share):
            self._optimiser.zero_grad()
        self._optimiser.step()
        with torch.no_grad():
            self.checkpoint["xyz"].clamp_(-1.0, 1.0)
        self.step += 1
        if self.step == self.config.steps:
            self._bake()

    def _learn_body(self) -> None:
        decoded = decode_human(self.checkpoint)
        relative = decoded["scales"] / self.checkpoint["scaling_multiplier"]
        loss = ((decoded["sh"][:, 0] - self._body_sh) ** 2).mean() + ((relative - 1.0) ** 2).mean()
        loss = loss + ((decoded["opacities"] - self._body_opacity) ** 2).mean() + self._pull(decoded)
        loss.backward()  # type: ignore[no-untyped-call]
        self.loss = float(loss.detach())

    def _learn_frame(self, share: float) -> bool:
        """Gradients of one frame, and a step of its pose; False if the frame is held out."""
        frame, view, rng = self._next_view(share)
        posed = self.rig.pose(frame)
        A, B = (part.detach().float().requires_grad_() for part in (posed.A, posed.B))
        decoded = decode_human(self.checkpoint)
        around = self._around(frame)
        self._derive(frame, self._rasterize(decoded, A, B, view, around), view, rng, self._pull(decoded))
        held = frame in self.held
        if self.surroundings is not None and not held:
            by_opacities, by_sh = (around[name].grad for name in ("opacities", "sh"))
            assert by_opacities is not None
            assert by_sh is not None
            rows = np.flatnonzero(by_sh.abs().sum(dim=(1, 2)).numpy())
            self.surroundings.step(frame, rows, by_opacities.numpy()[rows], by_sh[:, 0].numpy()[rows])
        names = ("pose", "root") if held or self._fixed or share > LENGTHS_UNTIL else ("size", "bones", "pose", "root")
        assert A.grad is not None
        assert B.grad is not None
        rates = {name: between(RIG_RATES[name], share) for name in names}
        self.rig.step(posed, A.grad.numpy(), B.grad.numpy(), rates)
        return not held

    def _pull(self, decoded: dict[str, Tensor]) -> Tensor:
        """How far skinning is from the body's, and Gaussians from their points; and needles."""
        off_m = decoded["means"] - self.checkpoint["xyz"]
        weights = ((decoded["weights"] - self._body_weights) ** 2).mean()
        total: Tensor = _WEIGHTS_PULL * weights + _OFFSET_PULL * (off_m**2).sum(dim=1).mean()
        if self.config.isotropy > 0.0:
            shapes = decoded["scales"].abs().clamp(min=_SCALE_MIN_M).log()
            total = total + self.config.isotropy * needle_loss(shapes)
        return total

    def _around(self, frame: int) -> dict[str, Tensor]:
        """What a frame shows of the surroundings; empty if they are unknown."""
        if self.surroundings is None:
            return {}
        return {
            name: torch.from_numpy(array).requires_grad_() for name, array in self.surroundings.arrays(frame).items()
        }

    def _rasterize(
        self, decoded: dict[str, Tensor], A: Tensor, B: Tensor, view: PersonView, around: dict[str, Tensor]
    ) -> Rendered:
        """Draw what is decoded over black, with all 24 weights; the blend's turn has no gradient."""
        shaped, _ = _blend(decoded["weights"], B, decoded["means"])
        means, M = _blend(decoded["weights"], A, shaped)
        q_blend = nearest_quat(M.detach()[:, :, :3])
        tensors = (
            means,
            quat_multiply(q_blend, nearest_quat(rotations_of_sixes(decoded["sixes"]))),
            decoded["scales"].abs().clamp(min=_SCALE_MIN_M) * self.rig.size,
            decoded["opacities"],
            decoded["sh"][:, :1].contiguous(),
        )
        features = None
        if around:
            features = person_feature(len(means), len(around["means_m"]))
            means, quats, scales, opacities, sh = (
                torch.cat(pair) for pair in zip(tensors, around.values(), strict=True)
            )
        else:
            means, quats, scales, opacities, sh = tensors
        return rasterize(
            means,
            quats,
            scales,
            opacities,
            sh,
            features,
            T_world_camera=torch.from_numpy(view.T_world_camera),
            K_px=view.K_px,
            height_px=view.mask.shape[0],
            width_px=view.mask.shape[1],
            sh_degree=0,
        )

    def _bake(self) -> None:
        with torch.no_grad():
            decoded = decode_human(self.checkpoint)
            quats = nearest_quat(rotations_of_sixes(decoded["sixes"].double()))
            opacities = decoded["opacities"].double().clamp(1e-6, 1.0 - 1e-6)
        joint, weight = strongest_four(decoded["weights"].double().numpy())
        gaussians = Gaussians.fresh(
            {
                "means_m": decoded["means"].numpy(),
                "quats_wxyz": quats.float().numpy(),
                "log_scales": decoded["scales"].abs().clamp(min=_SCALE_MIN_M).log().numpy(),
                "logits": torch.logit(opacities).float()[:, None].numpy(),
                "sh": decoded["sh"][:, 0].numpy(),
            }
        )
        self.bound = BoundGaussians(gaussians, joint, weight.astype(np.float32), self.bound.anchor_m)

    def released(self) -> dict[str, Any]:
        """A checkpoint with all that HUGS' own has."""
        geometry, count = self.checkpoint["geometry_dec"], len(self)
        shared = {
            f"{head}.0.{name.removeprefix('net.')}": tensor
            for head in ("xyz", "rotations", "scales")
            for name, tensor in geometry.items()
            if name.startswith("net.")
        }
        nothing = torch.zeros(count, 1)
        whole = {**self.checkpoint, "geometry_dec": {**geometry, **shared}}
        return {
            **_detached(whole),
            "active_sh_degree": 0,
            "max_radii2D": nothing[:, 0].clone(),
            "xyz_gradient_accum": nothing.clone(),
            "denom": nothing.clone(),
            "optimizer": {},
            "spatial_lr_scale": 1.0,
        }


def spread_body(body: Avatar, pelvis_m: Float64Array) -> Avatar:
    """A body in HUGS' da-pose, in SMPL's frame; it is skinned as before.

    Args:
        body: In any canonical pose.
        pelvis_m: Where its pelvis is to be in the T-pose [m], shape (3,).
    """
    c, t = body.joints_canonical_m.astype(np.float64), body.joints_tpose_m.astype(np.float64)
    R = body.R_tpose_canonical.astype(np.float64)
    moved = t + (pelvis_m - t[0])
    G, P = da_pose(moved)
    # Canonical pose -> T-pose -> da-pose, joint by joint.
    L = G @ R
    shift = P - np.einsum("jik,jk->ji", L, c)
    weights = body.lbs_weight.astype(np.float64)
    blended = np.einsum("nk,nkij->nij", weights, L[body.lbs_index])
    means = np.einsum("nij,nj->ni", blended, body.cloud.means_m.astype(np.float64))
    means += np.einsum("nk,nki->ni", weights, shift[body.lbs_index])
    turns = quat_from_matrix(nearest_rotation(blended))
    quats = multiply_quats(turns, body.cloud.quats_wxyz.astype(np.float64))
    cloud = dataclasses.replace(
        body.cloud, means_m=means.astype(np.float32), quats_wxyz=np.asarray(quats, dtype=np.float32)
    )
    return dataclasses.replace(
        body,
        cloud=cloud,
        joints_canonical_m=P.astype(np.float32),
        joints_tpose_m=moved.astype(np.float32),
        R_tpose_canonical=np.ascontiguousarray(G.transpose(0, 2, 1)).astype(np.float32),
    )


def _thin(body: Avatar, count: int) -> Avatar:
    """The body with at most so many Gaussians, evenly taken and as much larger."""
    if len(body.cloud) <= count:
        return body
    rows = np.random.default_rng(0).permutation(len(body.cloud))[:count]
    cloud, factor = body.cloud.select(rows), math.sqrt(len(body.cloud) / count)
    cloud = dataclasses.replace(cloud, scales_m=cloud.scales_m * np.float32(factor))
    return dataclasses.replace(body, cloud=cloud, lbs_index=body.lbs_index[rows], lbs_weight=body.lbs_weight[rows])


def new_checkpoint(xyz: Float32Array, sizes_m: Float32Array, seed: int) -> dict[str, Any]:
    """Planes and decoders of round Gaussians that lie at their points, before they have learned anything.

    Args:
        xyz: Points in the da-pose [m], within -1..1, shape (N, 3).
        sizes_m: Standard deviations of the Gaussians [m], shape (N, 1).
        seed: Of the random weights.
    """
    random = torch.Generator().manual_seed(seed)
    planes = {
        f"plane_{axes}": _FEATURE_SIGMA
        * interpolate(
            torch.randn(1, FEATURES, _CELLS, _CELLS, generator=random),
            size=(PLANE_SIDE, PLANE_SIDE),
            mode="bicubic",
            align_corners=True,
        )
        for axes in ("xy", "xz", "yz")
    }
    decoders: dict[str, dict[str, Tensor]] = {}
    for name, hidden in _HIDDEN.items():
        decoders[name] = _linear("net.0", hidden, 3 * FEATURES, random) | _linear("net.2", hidden, hidden, random)
    appearance, geometry, deformation = decoders.values()
    appearance |= _linear("opacity.0", 1, 64, random) | _linear("shs", 48, 64, random)
    for head, bias in (
        ("xyz.1", (0.0, 0.0, 0.0)),
        ("rotations.1", (1.0, 0.0, 0.0, 0.0, 1.0, 0.0)),
        ("scales.1", (_GELU_ONE,) * 3),
    ):
        geometry |= _linear(head, len(bias), 128, random, gain=0.01)
        geometry[f"{head}.bias"] = torch.tensor(bias)
    skinning = _linear("skinning_linear", 128, 128, random)
    v = skinning.pop("skinning_linear.weight")
    deformation |= skinning | {
        "skinning_linear.weight_g": v.norm(dim=1, keepdim=True),
        "skinning_linear.weight_v": v,
    }
    deformation |= _linear("skinning", 24, 128, random)
    checkpoint = {"xyz": torch.from_numpy(xyz.copy()), "triplane": planes, **decoders}
    for tensor in _tensors(checkpoint).values():
        tensor.requires_grad_()
    return {**checkpoint, "scaling_multiplier": torch.from_numpy(sizes_m.copy())}


def _linear(name: str, outputs: int, inputs: int, random: torch.Generator, *, gain: float = 1.0) -> dict[str, Tensor]:
    limit = gain / math.sqrt(inputs)
    return {
        f"{name}.weight": limit * (2.0 * torch.rand(outputs, inputs, generator=random) - 1.0),
        f"{name}.bias": torch.zeros(outputs),
    }


def _tensors(checkpoint: dict[str, Any]) -> dict[str, Tensor]:
    """What is learned of a checkpoint or of parts of one, by names with dots."""
    found: dict[str, Tensor] = {}
    for name in _RATES.keys() & checkpoint.keys():
        value = checkpoint[name]
        found |= {f"{name}.{key}": each for key, each in value.items()} if isinstance(value, dict) else {name: value}
    return dict(sorted(found.items()))


def _detached(values: dict[str, Any]) -> dict[str, Any]:
    return {
        name: _detached(value) if isinstance(value, dict) else value.detach().clone() for name, value in values.items()
    }


def _blend(weights: Tensor, T: Tensor, points: Tensor) -> tuple[Tensor, Tensor]:
    """Points (N, 3) moved by blended transforms, and these, shape (N, 3, 4)."""
    M = (weights @ T.reshape(24, 12)).reshape(-1, 3, 4)
    return (M[:, :, :3] @ points[:, :, None])[:, :, 0] + M[:, :, 3], M
