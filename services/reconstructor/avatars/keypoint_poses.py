"""Body poses from keypoints in images over time: a fit of SMPL's skeleton to what cameras see of it.

The world is metric with z up, and the floor is z = 0. Unknown are stature and bones of the person, where the keypoints
lie on the body, and the pelvis and joints of every frame. The most probable values are found, all frames together:

    sum_fk c_fk rho(|project(x_fk) - u_fk| / sigma_px) + sum |joint - mean|^2 / sigma^2 + smoothness + floor + lengths

with confidences c and Geman and McClure's rho(r) = r^2 / (1 + r^2 / s^2). The floor holds up the lower foot, and what
of it is on the ground stays where it is (`contacts`). Source: Bogo et al., Keep It SMPL, 2016 (keypoints, priors,
robust loss).
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from readygo.common.arrays import BoolArray, Float64Array
from readygo.common.avatars import SMPL_PARENTS, Avatar
from readygo.common.avatars.torch_posing import Skeletons, joint_transforms, rotation_matrices
from readygo.common.errors import AvatarError
from readygo.services.reconstructor.avatars.config import AvatarFitConfig, PosePriorConfig
from readygo.services.reconstructor.avatars.contacts import (
    LEVEL_FLOOR,
    SOLE_JOINTS,
    carry,
    find_contacts,
    lift_cost,
    slip_cost,
    sole_offsets,
    standing_share,
    sunk_cost,
    unknown_lift_cost,
)
from readygo.services.reconstructor.avatars.keypoint_start import HEADINGS, KeypointViews, find_start
from readygo.services.reconstructor.avatars.keypoints import ANCHOR_HEIGHT_M, ANCHORS, mirror_name
from readygo.services.reconstructor.avatars.rig import BONE_OF_JOINT, BONE_SIGMA, BONES, SIZE_SIGMA, stretch_joints
from readygo.services.reconstructor.avatars.trajectory import second_differences

Tensor = torch.Tensor
_PRIOR_DEG = {
    0: ((0, 0, 0), (1e3, 1e3, 1e3)),
    1: ((-10, 0, 3), (35, 18, 12)),
    4: ((20, 0, 0), (35, 6, 5)),
    7: ((0, 0, 0), (15, 8, 8)),
    3: ((3, 0, 0), (9, 8, 6)),
    6: ((3, 0, 0), (9, 8, 6)),
    9: ((0, 0, 0), (6, 8, 6)),
    12: ((0, 0, 0), (10, 12, 6)),
    15: ((0, 0, 0), (10, 12, 6)),
    13: ((0, 0, 0), (4, 6, 6)),
    16: ((0, 0, -65), (30, 35, 30)),
    18: ((0, -25, 0), (15, 40, 6)),
}
"""Means and standard deviations of the joints of the middle and of the left about SMPL's axes [deg]."""
_PAIRED = (1, 4, 7, 13, 16, 18)
_STILL_DEG = 0.5
"""Joints without a prior hardly move: hands and toes."""
_FLEXION = ((4, 0, 1.0), (5, 0, 1.0), (18, 1, -1.0), (19, 1, 1.0))
"""Knees and elbows, the axis that they bend about, and the direction."""
_FLEXION_MAX_DEG, _LIMIT_DEG = 150.0, 2.0
_PRIOR_WEIGHT = 0.1
"""Frames that follow each other hardly tell more of what is usual than one of them."""
_SHARED_WEIGHT = 0.3
"""Priors of what frames share, for each frame: errors of a model are the same in all of them."""
_SOLE_SIGMA_M = 0.015
"""Deviation of the heights of people's ankles and balls above their soles [m]."""
_DEPTH_MIN_M = 0.1
_ROBUST = 4.0
"""Scale of the robust loss in sigmas: what is farther off counts little."""
_STAGES = ((3.0, 120), (1.0, 120), (1.0, 150))
"""Deviation of keypoints relative to the last, and iterations, of each stage; contacts are found between them."""
_UNITS = {"place": 0.05, "pose": 0.15, "size": 0.03, "bones": 0.05, "offsets": 0.02, "soles": 0.01}
"""What the variables are measured in, so that their steps are alike."""
_SIDES = (("eye", "ear"), ("shoulder", "elbow", "wrist"), ("hip", "knee", "ankle", "toe", "heel"))
"""Parts of the body whose sides networks confuse together."""
_SWAP_GAIN, _SWAP_MARGIN = 0.5, 4.0
"""Sides are exchanged where the keypoints then cost less than this share, and less by this in sigmas."""
_SWAPPED_FRAMES_MAX = 0.5
_HEIGHTS_M, _MISS_MAX_SIGMAS = (0.8, 2.4), 5.0


@dataclass(frozen=True, kw_only=True, eq=False)
class KeypointPoses:
    """What keypoints tell of a person over time."""

    root_m: Float64Array
    """Pelvises [m], shape (F, 3)."""
    pose_axis_angle: Float64Array
    """Rotations of the joints as in `Motion` [rad], shape (F, 24, 3)."""
    joints_tpose_m: Float64Array
    """Joints of the person in the T-pose [m], shape (24, 3)."""
    miss_px: float
    """Median distance of the seen keypoints from where the person has them."""
    notes: tuple[str, ...] = ()
    """Hints for the user."""


def fit_poses(views: KeypointViews, bodies: Sequence[Avatar], config: AvatarFitConfig) -> KeypointPoses:
    """Find the poses of a person.

    Args:
        views: What is seen, at least three frames.
        bodies: Bodies whose mean proportions a person is expected to have.
        config: How; its `keypoints` and its `prior`.

    Raises:
        AvatarError: If most frames have left and right exchanged, or what is found is no person.
    """
    fit = PoseFit(views, mean_skeleton(bodies), views.sigma_px(config.keypoints.sigma_share), config.prior)
    fit.begin()
    for number, (blur, iterations) in enumerate(_STAGES):
        if number > 0:
            fit.repair_sides()
        fit.solve(blur, iterations)
        fit.find_contacts()
    swapped = fit.swapped_frames()
    frames, count = int(swapped.sum()), len(swapped)
    if frames > _SWAPPED_FRAMES_MAX * count:
        raise AvatarError(
            f"Left and right keypoints are exchanged in {frames} of {count} frames: left must be the person's left, "
            "not that of the image."
        )
    found = fit.found()
    note = f"left and right keypoints were exchanged in {frames} of {count} frames; they are repaired."
    return dataclasses.replace(found, notes=(note,)) if frames else found


def mean_skeleton(bodies: Sequence[Avatar]) -> Float64Array:
    """Joints in the T-pose of a body of `ANCHOR_HEIGHT_M` with the bodies' mean proportions [m], shape (24, 3)."""
    joints = [ANCHOR_HEIGHT_M / body.height_m * body.joints_tpose_m.astype(np.float64) for body in bodies]
    return np.asarray(np.mean(joints, axis=0))


def pose_prior() -> tuple[Float64Array, Float64Array]:
    """Mean and standard deviation of each joint's rotation [rad], shape (24, 3) each."""
    mean, sigma = np.zeros((24, 3)), np.full((24, 3), _STILL_DEG)
    for joint, (middle, spread) in _PRIOR_DEG.items():
        mean[joint], sigma[joint] = middle, spread
        if joint in _PAIRED:
            mean[joint + 1], sigma[joint + 1] = np.array([1.0, -1.0, -1.0]) * middle, spread
    return np.deg2rad(mean), np.deg2rad(sigma)


class PoseFit:
    """A fit under way."""

    def __init__(self, views: KeypointViews, tpose_m: Float64Array, sigma_px: float, prior: PosePriorConfig) -> None:
        """Begin with a person of mean proportions.

        Args:
            views: What is seen.
            tpose_m: Joints of that person in the T-pose [m], soles at y = 0, shape (24, 3).
            sigma_px: Deviation of keypoints.
            prior: How smooth motions are.
        """
        self._views, self._sigma_px, self._smooth = views, sigma_px, prior
        self._K, self._T = torch.tensor(views.K_px), torch.tensor(views.T_world_camera)
        self._off_middle = torch.tensor(0.5 * second_differences(views.times))
        self._see()
        self._swapped = np.zeros(views.keypoints.seen.shape, dtype=np.bool_)
        names = views.keypoints.names
        anchors, own = [ANCHORS[name] for name in names], [name for name in names if not name.startswith("right")]
        self._joints = [anchor.joint for anchor in anchors]
        self._anchors_m = torch.tensor([anchor.offset_m for anchor in anchors], dtype=torch.float64)
        self._own = torch.tensor([own.index(name if name in own else mirror_name(name)) for name in names])
        side = {"left": 1.0, "right": -1.0}
        mirror = [(side.get(name.partition("_")[0], 0.0), 1.0, 1.0) for name in names]
        self._mirror = torch.tensor(mirror, dtype=torch.float64)
        self._anchor_sigma = torch.tensor([ANCHORS[name].sigma_m for name in own], dtype=torch.float64)[:, None]
        self._tpose_m = torch.tensor(tpose_m)
        self._soles_m = sole_offsets(tpose_m, 0.0)
        self._mean, self._sigma = (torch.tensor(each) for each in pose_prior())
        self._contacts: Tensor | None = None
        count = len(views.keypoints)
        self.values = {
            "place": torch.zeros(count, 3, dtype=torch.float64),
            "pose": self._mean.repeat(count, 1, 1),
            "size": torch.zeros(1, dtype=torch.float64),
            "bones": torch.zeros(len(BONES), dtype=torch.float64),
            "offsets": torch.zeros(len(own), 3, dtype=torch.float64),
            "soles": torch.zeros(2, dtype=torch.float64),
        }

    def begin(self) -> None:
        """Stand the person where the keypoints are, with sides exchanged where they fit better so."""
        turned = {**self.values, "pose": self._mean.repeat(HEADINGS, 1, 1)}
        turned["pose"][:, 0, 1] = 2.0 * np.pi * torch.arange(HEADINGS, dtype=torch.float64) / HEADINGS
        points, soles, _ = self._pose_body(turned, torch.zeros(HEADINGS, 3, dtype=torch.float64))
        start = find_start(self._views, points.numpy(), -float(soles[..., 2].min()), self._sigma_px)
        self.values["place"] = torch.tensor(start.root_m) / start.scale - self._T[:, :3, 3] / start.scale
        self.values["pose"][:, 0, 1] = torch.tensor(start.heading_rad)
        self.values["size"][0] = float(np.log(start.scale))
        self._swap(np.broadcast_to(start.swapped[:, None], self._swapped.shape))

    def solve(self, blur: float, iterations: int) -> None:
        """Change all values, with keypoints whose deviation is `blur` times as large.

        Source: Liu & Nocedal, On the limited memory BFGS method for large scale optimization, 1989.
        """
        leaves = {name: (value / _UNITS[name]).requires_grad_(True) for name, value in self.values.items()}
        optimiser = torch.optim.LBFGS(
            list(leaves.values()), max_iter=iterations, history_size=40, line_search_fn="strong_wolfe"
        )

        def cost() -> Tensor:
            optimiser.zero_grad()
            loss = self._cost({name: leaf * _UNITS[name] for name, leaf in leaves.items()}, blur)
            loss.backward()  # type: ignore[no-untyped-call]
            return loss

        optimiser.step(cost)  # type: ignore[no-untyped-call]
        self.values = {name: (leaf * _UNITS[name]).detach() for name, leaf in leaves.items()}

    def find_contacts(self) -> None:
        """Soles that stand on the floor from one frame to the next."""
        _, soles, _ = self._pose_body(self.values, self._root(self.values))
        self._contacts = find_contacts(soles, LEVEL_FLOOR)

    def repair_sides(self) -> None:
        """Exchange left and right of parts of the body in frames where that fits far better."""
        points, _, _ = self._pose_body(self.values, self._root(self.values))
        expected, keypoints = self._project(points).numpy(), self._views.keypoints
        costs = []
        for order in (np.arange(len(self._joints)), keypoints.mirror):
            squares = np.square((expected - keypoints.uv_px[:, order]) / self._sigma_px).sum(axis=2)
            costs.append((keypoints.confidence * keypoints.seen)[:, order] * squares / (1.0 + squares / _ROBUST**2))
        swapped = np.zeros(keypoints.seen.shape, dtype=bool)
        for endings in _SIDES:
            part = np.array([name[:4] != "hip" and name.endswith(endings) for name in keypoints.names])
            now, then = (cost[:, part].sum(axis=1) for cost in costs)
            swapped[:, part] |= (then < _SWAP_GAIN * now - _SWAP_MARGIN)[:, None]
        self._swap(swapped)

    def swapped_frames(self) -> BoolArray:
        """Frames with keypoints that are seen and now on the other side than they were given, shape (F,)."""
        keypoints = self._views.keypoints
        paired = keypoints.mirror != np.arange(len(keypoints.names))
        return np.asarray((self._swapped & keypoints.seen & paired).any(axis=1))

    def found(self) -> KeypointPoses:
        """What is found.

        Raises:
            AvatarError: If it is no person.
        """
        points, _, tpose = self._pose_body(self.values, self._root(self.values))
        seen = self._views.keypoints.seen
        miss_px = float(
            np.median(np.linalg.norm(self._project(points).numpy() - self._views.keypoints.uv_px, axis=2)[seen])
        )
        if miss_px > _MISS_MAX_SIGMAS * self._sigma_px:
            raise AvatarError(
                f"No person fits the keypoints: they are {miss_px:.0f} px off in the median; look at the cameras, and "
                "at the order of keypoints and images."
            )
        size = float((tpose[15, 1] - tpose[7, 1]) / (self._tpose_m[15, 1] - self._tpose_m[7, 1]))
        if not _HEIGHTS_M[0] < size * ANCHOR_HEIGHT_M < _HEIGHTS_M[1]:
            raise AvatarError(
                f"By the keypoints the person is {size * ANCHOR_HEIGHT_M:.2f} m tall: cameras must be in metres, "
                "with the floor at z = 0."
            )
        return KeypointPoses(
            root_m=self._root(self.values).numpy(),
            pose_axis_angle=self.values["pose"].numpy().copy(),
            joints_tpose_m=tpose.numpy(),
            miss_px=miss_px,
        )

    def _see(self) -> None:
        keypoints = self._views.keypoints
        self._uv_px, self._weight = torch.tensor(keypoints.uv_px), torch.tensor(keypoints.confidence * keypoints.seen)

    def _swap(self, swapped: BoolArray) -> None:
        self._swapped ^= swapped
        self._views = dataclasses.replace(self._views, keypoints=self._views.keypoints.with_swapped(swapped))
        self._see()

    def _root(self, values: dict[str, Tensor]) -> Tensor:
        """Pelvises [m], shape (F, 3): at another size, images stay alike if distances grow as people do."""
        return self._T[:, :3, 3] + torch.exp(values["size"]) * values["place"]

    def _pose_body(self, values: dict[str, Tensor], root_m: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Keypoints (F, K, 3) and soles (F, 4, 3) in the world, and the T-pose (24, 3) [m]."""
        size, along = torch.exp(values["size"][0]), torch.exp(values["bones"])[torch.tensor(BONE_OF_JOINT)]
        tpose = stretch_joints(self._tpose_m, size, along, torch.zeros_like(self._tpose_m))
        skeleton = Skeletons(
            tpose_m=tpose[None],
            canonical_m=torch.zeros_like(tpose)[None],
            R_tpose_canonical=torch.eye(3, dtype=torch.float64).repeat(1, 24, 1, 1),
            parents=torch.tensor(np.maximum(SMPL_PARENTS, 0).astype(np.int64)),
        )
        only = torch.zeros(len(root_m), dtype=torch.int64)
        A = joint_transforms(skeleton, only, root_m, values["pose"])
        lift = torch.nn.functional.pad(values["soles"].repeat_interleave(2)[:, None], (1, 1))
        soles = carry(A[:, SOLE_JOINTS], size * (self._soles_m + lift))
        offsets = self._anchors_m + values["offsets"][self._own] * self._mirror
        return carry(A[:, self._joints], size * offsets), soles, tpose

    def _project(self, points_m: Tensor) -> Tensor:
        p = (points_m - self._T[:, None, :3, 3]) @ self._T[:, :3, :3]
        return (
            p[..., :2] / p[..., 2:].clamp(min=_DEPTH_MIN_M) * self._K[:, None, [0, 1], [0, 1]] + self._K[:, None, :2, 2]
        )

    def _cost(self, values: dict[str, Tensor], blur: float) -> Tensor:
        """How unlikely values are."""
        points, soles, _ = self._pose_body(values, self._root(values))
        squares = ((self._project(points) - self._uv_px) / (blur * self._sigma_px)).square().sum(dim=-1)
        cost = (self._weight * squares / (1.0 + squares / _ROBUST**2)).sum()
        cost = cost + _PRIOR_WEIGHT * ((values["pose"] - self._mean) / self._sigma)[:, 1:].square().sum()
        for joint, axis, sign in _FLEXION:
            bend = sign * torch.rad2deg(values["pose"][:, joint, axis])
            beyond = torch.relu(-bend) + torch.relu(bend - _FLEXION_MAX_DEG)
            cost = cost + (beyond / _LIMIT_DEG).square().sum()
        for name, sigma in (
            ("bones", BONE_SIGMA),
            ("size", SIZE_SIGMA),
            ("offsets", self._anchor_sigma),
            ("soles", _SOLE_SIGMA_M),
        ):
            cost = cost + _SHARED_WEIGHT * len(self._uv_px) * (values[name] / sigma).square().sum()
        return cost + self._unsteadiness(values) + self._floating(soles)

    def _unsteadiness(self, values: dict[str, Tensor]) -> Tensor:
        """How far joints and pelvis are from a steady motion through the frames before and after."""
        R, root, smooth = rotation_matrices(values["pose"]), self._root(values), self._smooth
        turned, moved = self._off_middle @ R.flatten(1), self._off_middle @ root
        turn: Tensor = turned.square().sum() / (2.0 * np.deg2rad(smooth.jerk_deg) ** 2)
        return turn + (moved / smooth.jerk_m).square().sum()

    def _floating(self, soles_m: Tensor) -> Tensor:
        """How far soles are from the floor; the lowest while contacts are not known, those that stand afterwards."""
        heights_m = LEVEL_FLOOR.heights(soles_m)
        sunk = sunk_cost(heights_m)
        if self._contacts is None:
            return sunk + unknown_lift_cost(heights_m)
        lifted = lift_cost(heights_m, standing_share(self._contacts))
        return sunk + lifted + slip_cost(soles_m[1:] - soles_m[:-1], self._contacts)
