"""Settings of the recorder."""

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class RecorderConfig:
    """How episodes become shards; the samples' bytes do not depend on it."""

    episodes_per_shard: int = 50
    """Episodes per shard file."""
    fsync: bool = True
    """False trades durability for speed: a power cut may then lose acknowledged episodes."""
    buffer_mib: int = 512
    """Unfinished episodes above this are dropped, the longest untouched first; their senders send them again [MiB]."""

    def __post_init__(self) -> None:
        for name in ("episodes_per_shard", "buffer_mib"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}.")
