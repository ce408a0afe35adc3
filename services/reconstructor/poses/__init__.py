"""Cameras and points of images, through COLMAP, and whether they can be trusted."""
