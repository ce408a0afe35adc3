"""Random streams: every (seed, split, index, purpose) has its own, disjoint from all others."""

import enum

import numpy as np

from readygo.common.messages.episode import EpisodeKey, Split

_SPLIT_CODE = {Split.TRAIN: 0, Split.VAL: 1, Split.TEST: 2}


class Purpose(enum.IntEnum):
    """What a stream is for; numbers are part of the data's identity and never change."""

    SCENARIO = 0
    MOTION = 1
    EXPERT = 2
    SENSOR = 3
    AVATAR = 4
    DRIVER = 5
    DISTURBANCE = 6
    ABSENCE = 7
    ROBOT = 8
    PERCEPTION = 9
    REACTION = 10
    STANDING = 11


def episode_rng(episode: EpisodeKey, purpose: Purpose) -> np.random.Generator:
    """The random generator of one purpose in one episode."""
    entropy = (episode.seed, _SPLIT_CODE[episode.split], episode.index, int(purpose))
    return np.random.Generator(np.random.Philox(np.random.SeedSequence(entropy)))
