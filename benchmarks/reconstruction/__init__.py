"""Benchmarks of what the reconstructor does."""
