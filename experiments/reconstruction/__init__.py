"""Experiments with reconstruction: simulated captures beside the truth, and trainings of Gaussians."""
