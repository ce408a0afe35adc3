"""People and free space as a network sees them in the robot's images, and who they are over time."""

from readygo.common.perception.artifact import PerceptionSpec
from readygo.common.perception.live import live_perception
from readygo.common.perception.people import People
from readygo.common.perception.perception import Perceived, Perception, load_perception
from readygo.common.perception.tracker import PeopleTracker, Track

__all__ = [
    "Perceived",
    "Perception",
    "PerceptionSpec",
    "People",
    "PeopleTracker",
    "Track",
    "live_perception",
    "load_perception",
]
