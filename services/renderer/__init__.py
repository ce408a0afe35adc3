"""The renderer: images of a scene with people in it."""
