"""Gaussian clouds, their transforms and their files."""

from common.gaussians.cloud import GaussianCloud
from common.gaussians.files import load_gaussians
from common.gaussians.ply import save_ply
from common.gaussians.spherical_harmonics import rotate_sh, sh_basis
from common.gaussians.transform import R_from_up, concatenate, crop, transform_cloud

__all__ = [
    "GaussianCloud",
    "R_from_up",
    "concatenate",
    "crop",
    "load_gaussians",
    "rotate_sh",
    "save_ply",
    "sh_basis",
    "transform_cloud",
]
