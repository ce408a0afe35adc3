"""Point-goal navigation among pedestrians as a Gymnasium environment. Needs the extra `gym`."""
