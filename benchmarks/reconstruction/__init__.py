"""Reconstruction of simulated captures, beside the truth."""
