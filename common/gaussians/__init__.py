"""Gaussian clouds, their transforms and their files."""

from readygo.common.gaussians.cloud import GaussianCloud
from readygo.common.gaussians.files import load_gaussians
from readygo.common.gaussians.ply import save_ply
from readygo.common.gaussians.spherical_harmonics import rgb_along, rgb_of_sh, sh_basis, sh_of_rgb
from readygo.common.gaussians.transform import R_from_up, concatenate, transform_cloud

__all__ = [
    "GaussianCloud",
    "R_from_up",
    "concatenate",
    "load_gaussians",
    "rgb_along",
    "rgb_of_sh",
    "save_ply",
    "sh_basis",
    "sh_of_rgb",
    "transform_cloud",
]
