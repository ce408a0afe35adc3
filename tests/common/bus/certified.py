"""A router that wants certificates, and participants who show one."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from readygo.common.bus.identity import Identity
from readygo.common.bus.rights import access_control
from readygo.common.bus.zenoh_bus import Router, ZenohBus, free_endpoint

WORKERS = ("renderer", "animator")


def certificates(folder: Path, *names: str, **options: float) -> None:
    """Issue certificates, with a new authority where there is none."""
    from readygo.apps.fleet.certificates import issue, make_authority

    if not (folder / "ca.key").exists():
        make_authority(folder)
    for name in names:
        issue(folder, folder, name, hosts=("localhost", "127.0.0.1"), **options)


def identity(folder: Path, name: str) -> Identity:
    """As somebody has it who does not look at the files."""
    return Identity(
        name=name, certificate=folder / f"{name}.pem", key=folder / f"{name}.key", authority=folder / "ca.pem"
    )


@contextmanager
def certified_router(folder: Path) -> Iterator[tuple[str, Callable[[str], ZenohBus]]]:
    """Its endpoint, and what joins run "test" under a name."""
    endpoint = free_endpoint().replace("tcp/", "tls/")
    router = Router(
        endpoint, identity=identity(folder, "coordinator"), access=access_control(WORKERS, ("rec0", "rec1"))
    )
    with ExitStack() as stack:
        stack.callback(router.close)

        def join(name: str) -> ZenohBus:
            bus = ZenohBus(endpoint, "test", identity=identity(folder, name))
            stack.callback(bus.close)
            return bus

        yield endpoint, join
