"""Experiments with policies."""
