"""Point-goal navigation among people as a Gymnasium environment. Needs the extra `gym`."""
