"""What is to be seen in a picture."""

import numpy as np

from readygo.common.drawing.plan_view import FREE

HUMAN = [(0.0, 5.3)]


def has(picture, colour):
    return bool((picture == np.array(colour, np.uint8)).all(axis=2).any())


def pixel(picture, view, x, y):
    u, v = view.world_to_pixel([x, y])
    return tuple(picture[int(v), int(u)].tolist())


def shone_through(colour, share, ground=FREE):
    return tuple(round(ground * (1 - share) + value * share) for value in colour)
