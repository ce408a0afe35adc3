"""Settings of metrics and logs of a run's processes."""

from dataclasses import dataclass

from readygo.apps.observe.logs import LogFormat
from readygo.common.errors import ConfigError
from readygo.common.extras import install_command, is_installed


@dataclass(frozen=True, kw_only=True)
class Observing:
    """Metrics and logs of the run's processes; by default text logs only."""

    metrics: str = ""
    """HOST:PORT of this process's Prometheus endpoint; port 0 takes a free one, which the log names. The other
    processes of the run use the same HOST, each with its own port; .readygo/targets in the data folder lists all."""
    log_format: LogFormat = "text"
    """"json" writes one JSON object per line, with run, worker, stage, episode and attempt."""

    def __post_init__(self) -> None:
        if self.metrics:
            address(self.metrics)

    def check_installed(self) -> None:
        """Check that the required packages are installed, before the run begins.

        Raises:
            ConfigError: If packages are missing.
        """
        if self.metrics and not is_installed("prometheus_client"):
            raise ConfigError(f"--metrics needs prometheus-client; run: {install_command('metrics')}")

    def of_member(self) -> list[str]:
        """Arguments of a process that this one starts on the same host, with a separate port for its metrics."""
        given = ["--log-format", self.log_format] if self.log_format != "text" else []
        if self.metrics:
            given += ["--metrics", f"{self.metrics.rpartition(':')[0]}:0"]
        return given


NOTHING = Observing()


def address(text: str) -> tuple[str, int]:
    """Host and port of HOST:PORT.

    Raises:
        ConfigError: If the text is malformed.
    """
    host, _, port = text.rpartition(":")
    if not host or not port.isdigit() or int(port) > 65535:
        raise ConfigError(
            f"--metrics must be HOST:PORT, such as 127.0.0.1:9464, got {text!r}; port 0 takes a free one."
        )
    return host.strip("[]"), int(port)
