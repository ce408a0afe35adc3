import pytest

from readygo.apps.cli import function_of, options_of, read_options
from readygo.apps.fleet.options import FleetOptions, RouterOptions
from readygo.commands import COMMANDS


@pytest.mark.parametrize("name", ["generate embedded --out o", "coordinator o", "learn embedded --out o", "evaluate"])
def test_router_is_named_the_same_way_everywhere(name: str) -> None:
    words = name.split()
    kind = options_of(function_of(COMMANDS[words[0]]))
    options = read_options(kind, [*words[1:], "--listen", "tls/lab:7447", "--certs", "c"], prog="readygo")
    assert isinstance(options.fleet, RouterOptions)
    assert (options.fleet.listen, str(options.fleet.certs)) == ("tls/lab:7447", "c")


def test_run_may_share_a_router() -> None:
    assert FleetOptions(connect="tcp/lab:7447").listen == ""
