"""Watching runs: a page with the scene and all numbers, and streams for Foxglove and Rerun."""
