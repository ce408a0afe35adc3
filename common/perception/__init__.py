"""People and free space as a network sees them in the robot's images, and who they are over time."""
