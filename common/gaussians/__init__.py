"""Gaussian clouds, their transforms and their files."""

from common.gaussians.cloud import GaussianCloud

__all__ = ["GaussianCloud"]
