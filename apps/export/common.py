"""Shared parts of several formats: the task in words, names of images."""

TASK = "Drive to the goal without touching anything or anybody."
"""The task of every episode, for formats that name it."""
_JPEG = b"\xff\xd8"


def suffix(image: bytes) -> str:
    """File extension of an encoded image."""
    return "jpg" if image.startswith(_JPEG) else "png"
