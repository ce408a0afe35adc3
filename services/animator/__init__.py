"""The animator: how humans move along their trajectories."""
