"""Reconstruction: of simulated captures beside the truth, and the training of Gaussians."""
