"""What an episode is, its random streams, how it is judged and how success is counted."""

from common.episode.config import EpisodeConfig
from common.episode.streams import Purpose, episode_rng

__all__ = ["EpisodeConfig", "Purpose", "episode_rng"]
