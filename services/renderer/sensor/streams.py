"""Random numbers of the sensor: one Philox key per episode, one block of its counter per frame."""

import hashlib
from dataclasses import dataclass

import numpy as np

from readygo.common.episode.streams import Purpose, episode_rng
from readygo.common.messages import EpisodeKey


@dataclass(frozen=True)
class SensorStream:
    """The stream that one episode's sensor draws from; frames can be drawn in any order."""

    key: tuple[int, int]
    """Philox key, two 64-bit words."""

    @classmethod
    def of_episode(cls, episode: EpisodeKey) -> "SensorStream":
        """The stream of a recorded episode."""
        words = episode_rng(episode, Purpose.SENSOR).bit_generator.state["state"]["key"]
        return cls((int(words[0]), int(words[1])))

    @classmethod
    def of_humans(cls, people: str) -> "SensorStream":
        """The stream of single views: the key of their people stands for the episode, which views do not carry."""
        digest = hashlib.sha256(people.encode()).digest()
        return cls((int.from_bytes(digest[:8], "little"), int.from_bytes(digest[8:16], "little")))

    def of_camera(self, name: str) -> "SensorStream":
        """The stream of a camera on the same robot; the first one, called "", has the episode's own."""
        return SensorStream.of_humans(f"{name} {self.key}") if name else self

    def of_draws(self) -> np.random.Generator:
        """Random generator for the values that hold over the episode."""
        return self._at(0)

    def of_frame(self, step: int) -> np.random.Generator:
        """Random generator for the noise of one frame."""
        return self._at(step + 1)

    def _at(self, block: int) -> np.random.Generator:
        # A block has 2^192 counter values: no two of them ever meet.
        counter = np.array([0, 0, 0, block], dtype=np.uint64)
        return np.random.Generator(np.random.Philox(key=np.array(self.key, dtype=np.uint64), counter=counter))
