"""Scenes and avatars packed for the CPU rasterizer."""
