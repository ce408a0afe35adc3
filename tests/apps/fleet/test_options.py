import pytest

from readygo.apps.cli import function_of, options_of, read_options
from readygo.apps.fleet.options import FleetOptions, RouterOptions
from readygo.commands import COMMANDS
from readygo.common.errors import ReadygoError


@pytest.mark.parametrize("name", ["generate embedded --out o", "coordinator o", "learn embedded --out o", "evaluate"])
def test_router_is_named_the_same_way_everywhere(name: str) -> None:
    words = name.split()
    kind = options_of(function_of(COMMANDS[words[0]]))
    options = read_options(kind, [*words[1:], "--listen", "tls/lab:7447", "--certs", "c"], prog="readygo")
    assert isinstance(options.fleet, RouterOptions)
    assert (options.fleet.listen, str(options.fleet.certs)) == ("tls/lab:7447", "c")


@pytest.mark.parametrize("name", ["generate embedded --out o", "coordinator o"])
def test_run_may_share_a_router(name: str) -> None:
    command, *words = name.split()
    kind = options_of(function_of(COMMANDS[command]))
    options = read_options(kind, [*words, "--connect", "tcp/lab:7447"], prog="readygo")
    assert options.fleet == FleetOptions(connect="tcp/lab:7447", listen="", certs=None)


@pytest.mark.parametrize("name", ["learn embedded --out o", "evaluate embedded"])
def test_learning_and_evaluating_have_a_router_of_their_own(name: str) -> None:
    command, *words = name.split()
    kind = options_of(function_of(COMMANDS[command]))
    with pytest.raises(ReadygoError, match="unknown option '--connect'"):
        read_options(kind, [*words, "--connect", "tcp/lab:7447"], prog="readygo")
