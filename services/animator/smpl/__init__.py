"""SMPL joint rotations fitted to joint positions."""
