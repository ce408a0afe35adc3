"""What is drawn in one go: cameras and the humans that each of them sees, as tensors."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from readygo.common.rasterizer.interface import View

OWN_COLOURS = np.zeros((3, 4, 4))
OWN_COLOURS[:, 3, 3] = 1.0
"""Light of 1 from everywhere, as in `readygo.common.gaussians.irradiance.irradiance_matrix`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ViewBatch:
    """B cameras with up to P humans each."""

    T_world_camera: Tensor
    """Camera poses, OpenCV axes, float64, shape (B, 4, 4)."""
    avatar: Tensor
    """Avatar of each human, int32, shape (B, P); -1: this place is empty."""
    root_m: Tensor
    """Pelvises in the z-up world [m], float64, shape (B, P, 3)."""
    pose_axis_angle: Tensor
    """Joint rotations [rad] as in `Motion`, float64, shape (B, P, 24, 3)."""
    light: Tensor
    """Light that falls on each human, as in `PosedHuman`; 1 from everywhere where they have their own colours, float64,
    shape (B, P, 3, 4, 4)."""

    def part(self, first: int, end: int) -> "ViewBatch":
        """Some of the cameras."""
        return ViewBatch(
            T_world_camera=self.T_world_camera[first:end],
            avatar=self.avatar[first:end],
            root_m=self.root_m[first:end],
            pose_axis_angle=self.pose_axis_angle[first:end],
            light=self.light[first:end],
        )


def make_batch(views: Sequence[View], numbers: Mapping[str, int], device: torch.device | str) -> ViewBatch:
    """Copy views to a device.

    Args:
        views: B views that are checked, see `readygo.common.rasterizer.interface.checked_outputs`.
        numbers: Number of each avatar.
        device: Where to.
    """
    most = max((len(view.humans) for view in views), default=0)
    T = np.array([view.T_world_camera for view in views], dtype=np.float64).reshape(-1, 4, 4)
    avatar = np.full((len(views), most), -1, dtype=np.int32)
    root, pose = np.zeros((len(views), most, 3)), np.zeros((len(views), most, 24, 3))
    light = np.tile(OWN_COLOURS, (len(views), most, 1, 1, 1))
    everyone = [human for view in views for human in view.humans]
    if everyone:
        camera = np.repeat(np.arange(len(views)), [len(view.humans) for view in views])
        place = np.concatenate([np.arange(len(view.humans)) for view in views])
        avatar[camera, place] = [numbers[human.avatar] for human in everyone]
        root[camera, place] = np.array([human.root_m for human in everyone])
        pose[camera, place] = np.array([human.pose_axis_angle for human in everyone])
        light[camera, place] = [OWN_COLOURS if human.light is None else human.light for human in everyone]
    return ViewBatch(
        T_world_camera=torch.from_numpy(T).to(device),
        avatar=torch.from_numpy(avatar).to(device),
        root_m=torch.from_numpy(root).to(device),
        pose_axis_angle=torch.from_numpy(pose).to(device),
        light=torch.from_numpy(light).to(device),
    )
