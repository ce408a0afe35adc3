"""Views of the robot's camera in a scene and in recorded data, to detect blur before training."""
