"""Settings of the coordinator."""

from dataclasses import dataclass, field

PRIORITY_MAX = 1000


@dataclass(frozen=True, kw_only=True)
class CoordinatorConfig:
    """Leases, limits and recorders; none of them changes a sample."""

    recorders: tuple[str, ...] = ("rec0",)
    """Names of the recorders that share the run's episodes; each is one process with its own shards."""
    folders: dict[str, str] = field(default_factory=dict)
    """Folders, by name, of recorders that have a separate disk; the others record into the data folder."""
    priority: int = 0
    """Workers of several runs do those with a higher one first."""
    lease_s: float = 15.0
    """A lease ends this long after its claim or latest renewal [s]."""
    plan_ahead: int = 64
    """Planning pauses while this many episodes are between planning and the shards, or two for each process there."""

    def __post_init__(self) -> None:
        for name in ("lease_s", "plan_ahead"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}.")
        if not -PRIORITY_MAX <= self.priority <= PRIORITY_MAX:
            raise ValueError(f"priority must be {-PRIORITY_MAX}..{PRIORITY_MAX}, got {self.priority}.")
        if not self.recorders or len(set(self.recorders)) != len(self.recorders):
            raise ValueError(f"recorders must be different names, at least one, got {list(self.recorders)}.")
        if not isinstance(self.folders, dict) or not all(isinstance(place, str) for place in self.folders.values()):
            raise ValueError(f"folders must be a table of folders by recorder, got {self.folders!r}.")
        if unknown := sorted(set(self.folders) - set(self.recorders)):
            raise ValueError(f"folders names {unknown[0]!r}, which is none of the recorders {list(self.recorders)}.")
        if len(set(self.folders.values())) < len(self.folders):
            raise ValueError(f"folders must differ from recorder to recorder, got {list(self.folders.values())}.")
