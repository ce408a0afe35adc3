"""Options of all commands that open, join or control a fleet."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, kw_only=True)
class RouterOptions:
    """The router that other processes of the run join."""

    listen: str = ""
    """Endpoint of the run's own router, such as tcp/127.0.0.1:7447 or tls/10.0.0.5:7447, for workers that you start by
    hand or on other machines; 0.0.0.0 stands for all addresses; by default a free loopback port, where one will do."""
    certs: Path | None = None
    """Folder of certificates (`readygo certs issue`) of the roles that run here, for a tls/ endpoint."""


@dataclass(frozen=True, kw_only=True)
class FleetOptions(RouterOptions):
    """The router of the run: its own, or one that several runs share."""

    connect: str = ""
    """Endpoint of a running router (`readygo router`) that several runs share, instead of `listen`."""


@dataclass(frozen=True, kw_only=True)
class JoinOptions:
    """A run of a fleet, instead of its data folder."""

    connect: str = ""
    """Endpoint of the fleet's router; its token is read from READYGO_TOKEN."""
    run: str = ""
    """Name of the run, as `readygo generate --listen` prints it."""
    certs: Path | None = None
    """Folder with an operator's or a monitor's certificate, for a tls/ endpoint."""
