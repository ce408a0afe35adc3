"""What an episode is, its random streams, how it is judged and how success is counted."""

from readygo.common.episode.collision import meets_human, meets_obstacle
from readygo.common.episode.conduct import Conduct, Contact, conduct_of
from readygo.common.episode.config import EpisodeConfig
from readygo.common.episode.grid_search import GridSearch, shortest_way_m
from readygo.common.episode.metrics import EpisodeResult, TaskSummary, summarize, wilson_interval
from readygo.common.episode.simulation import EpisodeSimulation, time_to_contact_s
from readygo.common.episode.straight_line import straight_line_command
from readygo.common.episode.streams import Purpose, episode_rng

__all__ = [
    "Conduct",
    "Contact",
    "EpisodeConfig",
    "EpisodeResult",
    "EpisodeSimulation",
    "GridSearch",
    "Purpose",
    "conduct_of",
    "TaskSummary",
    "episode_rng",
    "meets_human",
    "meets_obstacle",
    "shortest_way_m",
    "straight_line_command",
    "summarize",
    "time_to_contact_s",
    "wilson_interval",
]
