"""Experiments with planning."""
