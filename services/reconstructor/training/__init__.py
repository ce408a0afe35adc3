"""Gaussians from a posed COLMAP model, trained on the CPU."""
