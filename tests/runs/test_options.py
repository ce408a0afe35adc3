from pathlib import Path

import pytest

from readygo.apps.cli import function_of, options_of, read_options
from readygo.commands import COMMANDS
from readygo.runs.options import WorldOptions


@pytest.mark.parametrize("name", ["generate embedded --out o", "evaluate embedded", "plan embedded"])
def test_world_is_named_the_same_way_everywhere(name: str) -> None:
    words = name.split()
    kind = options_of(function_of(COMMANDS[words[0]]))
    options = read_options(kind, [*words[1:], "--avatars", "people", "--sensor", "off"], prog="readygo")
    assert options.world == WorldOptions(avatars=Path("people"), sensor="off")
