"""Avatars: their file, their skeleton and their posing."""

from common.avatars.avatar import SMPL_PARENTS, Avatar
from common.avatars.file import avatar_hash, avatar_paths, load_avatar, load_avatars, save_avatar
from common.avatars.footprint import FootprintModel, footprint_xy
from common.avatars.kinematics import joint_positions, joint_transforms
from common.avatars.labels import LabelModel, human_labels
from common.avatars.posing import pose_avatar

__all__ = [
    "SMPL_PARENTS",
    "Avatar",
    "FootprintModel",
    "LabelModel",
    "avatar_hash",
    "avatar_paths",
    "footprint_xy",
    "human_labels",
    "joint_positions",
    "joint_transforms",
    "load_avatar",
    "load_avatars",
    "pose_avatar",
    "save_avatar",
]
