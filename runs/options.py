"""Options of all commands that make the world of an episode."""

from dataclasses import dataclass
from pathlib import Path

from readygo.services.renderer import SensorName


@dataclass(frozen=True, kw_only=True)
class WorldOptions:
    """Pedestrians and camera of the episodes."""

    avatars: Path | None = None
    """Avatar file or folder of avatars; by default those of the policy's data, else the embedded ones. The suffix
    ":train" or ":test", also after "embedded", selects one part."""
    scenarios: Path | None = None
    """TOML file with starts, goals and pedestrians to play in order, instead of drawn ones."""
    sensor: SensorName | None = None
    """Recipe of the camera's lens, light and shutter and of their variation; overrides robot and `config`."""
