"""Levels of detail: trees of Gaussians, cut per view."""
