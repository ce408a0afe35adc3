"""What processes of a run are asked to show of themselves."""

from dataclasses import dataclass

from readygo.apps.cli import Group
from readygo.apps.observe.logs import LogFormat
from readygo.common.errors import ConfigError

OBSERVING = Group("observing")
"""Heading of its options."""


@dataclass(frozen=True, kw_only=True)
class Observing:
    """Chosen on the command line; nothing but lines to read by default."""

    metrics: str = ""
    """Where Prometheus finds this process, HOST:PORT; port 0 takes a free one, and empty serves nothing."""
    log_format: LogFormat = "text"
    traces: str = ""
    """Where spans go: an OTLP endpoint such as http://collector:4318, or a folder, for files of JSON lines."""

    def __post_init__(self) -> None:
        if self.metrics:
            address(self.metrics)

    def of_member(self) -> list[str]:
        """Arguments of a process that this one starts: on the same host, metrics on a port of its own."""
        given = ["--log-format", self.log_format] if self.log_format != "text" else []
        if self.metrics:
            given += ["--metrics", f"{self.metrics.rpartition(':')[0]}:0"]
        return [*given, *(["--traces", self.traces] if self.traces else [])]


NOTHING = Observing()


def address(text: str) -> tuple[str, int]:
    """Host and port of HOST:PORT.

    Raises:
        ConfigError: If it is none.
    """
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit() or int(port) > 65535:
        raise ConfigError(
            f"--metrics must be HOST:PORT, such as 127.0.0.1:9464, got {text!r}; port 0 takes a free one."
        )
    return host.strip("[]"), int(port)
