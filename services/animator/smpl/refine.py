"""Refinement of fitted SMPL rotations by optimisation, in the manner of SMPLify.

Slower than the closed form by far (seconds for 10 s of motion); it weighs joint errors against smoothness in time and
the plausibility of poses. The pose prior is the user's Gaussian mixture where its file is given, else limits of knees
and elbows and a mild pull to the start.

Source: Bogo et al., Keep it SMPL, ECCV 2016, equations 3 to 7; weights follow the fit of motion generators' joints.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from readygo.common.array_files import load_npz
from readygo.common.arrays import AnyArray, Float64Array
from readygo.common.avatars import SMPL_PARENTS
from readygo.common.errors import ConfigError
from readygo.common.frames import yup_from_zup, zup_from_yup
from readygo.common.messages import Motion
from readygo.common.pickles import array_of, load_pickle

POSE_COUNT = 69
_TOES = (10, 11)
GMOF_SIGMA_M = 0.1
"""Joint errors well above this count as outliers (Geman-McClure)."""
JOINTS_WEIGHT, SMOOTH_WEIGHT, PRIOR_WEIGHT, LIMITS_WEIGHT = 600.0**2 / 100.0**2, 0.1, 0.001, 0.5
"""Weights of the terms: errors in metres and radians, squared, averaged over frames."""
START_WEIGHT = 0.002
"""Weight of the pull to the rotations of the start, without a mixture."""
ITERATIONS = 60
"""Of L-BFGS."""
_PRIOR_KEYS = ("means", "covars", "weights")
_REMEDY = "give SMPLify's gmm_08.pkl"
_PRIOR_BYTES_MAX = 2**24
"""SMPLify's has 8 Gaussians in 0.3 MB."""


@dataclass(frozen=True, kw_only=True)
class PosePrior:
    """A Gaussian mixture over the 69 axis-angle numbers of joints 1..23."""

    means: Float64Array
    """Means of the mixture's K Gaussians, shape (K, 69)."""
    precisions: Float64Array
    """Inverse covariances, shape (K, 69, 69)."""
    costs: Float64Array
    """Minus the logarithm of each Gaussian's share and height, the smallest one 0, shape (K,)."""


def load_pose_prior(path: Path) -> PosePrior:
    """A prior from gmm_08.pkl of SMPLify, or an .npz, with `means` (K, 69), `covars` (K, 69, 69) and `weights` (K,).

    Raises:
        ConfigError: If the file cannot be read safely or holds something else.
    """
    try:
        means, covars, weights = (array.astype(np.float64) for array in _prior_arrays(path))
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise ConfigError(f"Pose prior {path} lacks numbers of {', '.join(_PRIOR_KEYS)}; {_REMEDY}.") from error
    count = len(weights) if weights.ndim == 1 else 0
    shapes = means.shape == (count, POSE_COUNT) and covars.shape == (count, POSE_COUNT, POSE_COUNT)
    if count == 0 or not shapes or not weights.min() > 0.0:
        raise ConfigError(
            f"Pose prior {path} must hold means (K, 69), covars (K, 69, 69) and positive weights (K,), got "
            f"{means.shape}, {covars.shape} and {weights.shape}."
        )
    try:
        half_logdet = np.log(np.diagonal(np.linalg.cholesky(covars), axis1=1, axis2=2)).sum(axis=1)
    except np.linalg.LinAlgError as error:
        raise ConfigError(f"Pose prior {path} has a covariance that is not positive definite.") from error
    costs = half_logdet - np.log(weights)
    precisions = np.asarray(np.linalg.inv(covars), dtype=np.float64)
    return PosePrior(means=means, precisions=precisions, costs=costs - costs.min())


def _prior_arrays(path: Path) -> Iterator[AnyArray]:
    """Arrays of a prior in the order of `_PRIOR_KEYS`."""
    if path.suffix == ".npz":
        entries: Any = load_npz(path, _PRIOR_KEYS, bytes_max=_PRIOR_BYTES_MAX, raises=ConfigError, remedy=_REMEDY)
    else:
        entries = load_pickle(path, bytes_max=_PRIOR_BYTES_MAX, raises=ConfigError, remedy=_REMEDY)
    for key in _PRIOR_KEYS:
        array = array_of(entries[key])
        if array is None or array.dtype.kind not in "fiu" or not np.isfinite(array).all():
            raise ValueError(key)
        yield array


def refine(
    motion: Motion,
    joints_m: npt.ArrayLike,
    offsets_m: npt.ArrayLike,
    prior: PosePrior | None = None,
    *,
    iterations: int = ITERATIONS,
) -> Motion:
    """A motion with joints closer to the given ones, smooth and plausible.

    Args:
        motion: Where to start, e.g. the rotations that `fit_rotations` finds for the same joints.
        joints_m: Joints 0..21 or 0..23 in the z-up world [m], shape (T, 22 or 24, 3).
        offsets_m: Each joint relative to its parent in the T-pose, y-up [m], shape (24, 3).
        prior: The user's mixture.
        iterations: Most iterations of L-BFGS.

    Returns:
        A motion of the same length; repeatable on one machine, not across processors.
    """
    joints = np.asarray(joints_m, dtype=np.float64)
    rows = len(motion.root_m)
    if joints.ndim != 3 or joints.shape[0] != rows or joints.shape[1] not in (22, 24) or joints.shape[2] != 3:
        raise ValueError(f"joints_m must have shape ({rows}, 22 or 24, 3) as the motion has rows, got {joints.shape}.")
    target = torch.from_numpy(yup_from_zup(joints))
    start = torch.from_numpy(motion.pose_axis_angle.astype(np.float64))
    pose = start.clone().requires_grad_()
    root = torch.from_numpy(yup_from_zup(motion.root_m))
    loss = _Loss(target, start, torch.from_numpy(np.asarray(offsets_m, dtype=np.float64)), prior)
    solver = torch.optim.LBFGS([pose], max_iter=iterations, history_size=20, line_search_fn="strong_wolfe")

    def closure() -> Tensor:
        solver.zero_grad()
        value = loss(pose, root)
        value.backward()  # type: ignore[no-untyped-call]
        return value

    solver.step(closure)  # type: ignore[no-untyped-call]
    return Motion(
        root_m=zup_from_yup(root.numpy()).astype(np.float32),
        pose_axis_angle=pose.detach().numpy().astype(np.float32),
        rate_hz=motion.rate_hz,
    )


def refine_in_place(motion: Motion, offsets_m: npt.ArrayLike, prior: PosePrior | None = None) -> Motion:
    """A motion whose limbs turn as bodies do, its joints where they were as far as that goes.

    The pelvis stays, and so do the toes, which no joint shows: they were bent to clear the floor. Arguments as of
    `refine`.
    """
    root = torch.from_numpy(yup_from_zup(motion.root_m))
    pose = torch.from_numpy(motion.pose_axis_angle.astype(np.float64))
    _, X = forward(pose, root, torch.from_numpy(np.asarray(offsets_m, dtype=np.float64)))
    refined = refine(motion, zup_from_yup(X.numpy()), offsets_m, prior)
    kept = refined.pose_axis_angle.copy()
    kept[:, _TOES] = motion.pose_axis_angle[:, _TOES]
    return Motion(root_m=motion.root_m, pose_axis_angle=kept, rate_hz=motion.rate_hz)


def rotations(pose: Tensor) -> Tensor:
    """Matrices (..., 3, 3) of axis-angle vectors (..., 3), differentiable at 0 too."""
    angle2 = (pose * pose).sum(-1)[..., None, None]
    small = angle2 < 1e-8
    angle = torch.where(small, torch.ones_like(angle2), angle2).sqrt()
    s = torch.where(small, 1.0 - angle2 / 6.0, torch.sin(angle) / angle)
    c = torch.where(small, 0.5 - angle2 / 24.0, (1.0 - torch.cos(angle)) / angle.square())
    x, y, z = pose.unbind(-1)
    zero = torch.zeros_like(x)
    K = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], dim=-1).reshape(*pose.shape[:-1], 3, 3)
    return torch.eye(3, dtype=pose.dtype) + s * K + c * (K @ K)


def forward(pose: Tensor, root: Tensor, offsets: Tensor) -> tuple[Tensor, Tensor]:
    """Global rotations (T, 24, 3, 3) and positions (T, 24, 3) of poses (T, 24, 3), y-up."""
    local = rotations(pose)
    G, X = [local[:, 0]], [root]
    for joint in range(1, 24):
        parent = int(SMPL_PARENTS[joint])
        G.append(G[parent] @ local[:, joint])
        X.append(X[parent] + G[parent] @ offsets[joint])
    return torch.stack(G, dim=1), torch.stack(X, dim=1)


class _Loss:
    """The objective: the weighted terms."""

    def __init__(self, target: Tensor, start: Tensor, offsets: Tensor, prior: PosePrior | None) -> None:
        self.target, self.start, self.offsets = target, start, offsets
        self.local0 = rotations(start)
        self.means = self.precisions = self.costs = None
        if prior is not None:
            self.means, self.precisions = torch.from_numpy(prior.means), torch.from_numpy(prior.precisions)
            self.costs = torch.from_numpy(prior.costs)

    def __call__(self, pose: Tensor, root: Tensor) -> Tensor:
        rows = len(pose)
        local = rotations(pose)
        _, X = forward(pose, root, self.offsets)
        error2 = (X[:, : self.target.shape[1]] - self.target).square().sum(-1)
        value = JOINTS_WEIGHT * (error2 / (1.0 + error2 / GMOF_SIGMA_M**2)).sum()
        if rows > 2:
            # Second differences: a steady turn costs nothing.
            value = value + SMOOTH_WEIGHT * (local[2:] - 2.0 * local[1:-1] + local[:-2]).square().sum()
        value = value + LIMITS_WEIGHT * _beyond_limits(pose)
        if self.means is None or self.precisions is None or self.costs is None:
            value = value + START_WEIGHT * (local - self.local0).square().sum()
        else:
            d = pose[:, 1:].reshape(rows, 1, POSE_COUNT) - self.means
            distance = 0.5 * torch.einsum("tki,kij,tkj->tk", d, self.precisions, d) + self.costs
            value = value + PRIOR_WEIGHT * distance.min(dim=1).values.sum()
        return value / rows


def _beyond_limits(pose: Tensor) -> Tensor:
    """Squared bends of knees and elbows the wrong way [rad2]: knees bend about +x, elbows about -y (left) and +y."""
    wrong = torch.stack([-pose[:, 4, 0], -pose[:, 5, 0], pose[:, 18, 1], -pose[:, 19, 1]])
    return wrong.clamp(min=0.0).square().sum()
