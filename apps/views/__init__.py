"""What the robot's camera shows in a scene, and what was recorded with it: fog is seen before it is learned from."""
