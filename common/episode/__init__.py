"""What an episode is, its random streams, how it is judged and how success is counted."""

from typing import TYPE_CHECKING

from readygo.common.lazy import lazy_names

if TYPE_CHECKING:
    from readygo.common.episode.collision import meets_obstacle as meets_obstacle
    from readygo.common.episode.conduct import Conduct as Conduct
    from readygo.common.episode.conduct import Contact as Contact
    from readygo.common.episode.config import EpisodeConfig as EpisodeConfig
    from readygo.common.episode.grid_search import GridSearch as GridSearch
    from readygo.common.episode.grid_search import shortest_way_m as shortest_way_m
    from readygo.common.episode.metrics import EpisodeResult as EpisodeResult
    from readygo.common.episode.metrics import TaskSummary as TaskSummary
    from readygo.common.episode.metrics import summarize as summarize
    from readygo.common.episode.metrics import wilson_interval as wilson_interval
    from readygo.common.episode.simulation import EpisodeSimulation as EpisodeSimulation
    from readygo.common.episode.streams import Purpose as Purpose
    from readygo.common.episode.streams import episode_rng as episode_rng
else:
    _NAMES = {
        ".collision": ("meets_obstacle",),
        ".conduct": (
            "Conduct",
            "Contact",
        ),
        ".config": ("EpisodeConfig",),
        ".grid_search": (
            "GridSearch",
            "shortest_way_m",
        ),
        ".metrics": (
            "EpisodeResult",
            "TaskSummary",
            "summarize",
            "wilson_interval",
        ),
        ".simulation": ("EpisodeSimulation",),
        ".streams": (
            "Purpose",
            "episode_rng",
        ),
    }
    __all__ = [name for names in _NAMES.values() for name in names]
    __getattr__ = lazy_names(__name__, _NAMES)
