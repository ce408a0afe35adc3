import shutil
import subprocess
from pathlib import Path

import pytest

from readygo.apps.cli_reference import completion, describe_command, reference
from readygo.commands import COMMANDS

PAGE = Path(__file__).resolve().parents[2] / "docs" / "commands.md"


def test_page_in_docs_is_what_the_code_says(request: pytest.FixtureRequest) -> None:
    text = reference(COMMANDS)
    if request.config.getoption("--update-golden"):
        PAGE.write_text(text)
    assert PAGE.read_text() == text, "docs/commands.md is old: run `make golden`"


def test_a_command_has_its_arguments_with_value_and_default() -> None:
    rows = {parameter.flag: parameter for parameter in describe_command(COMMANDS["play"]).options}
    assert list(rows) == ["DATA", "--out", "--episode", "--every", "--camera"]
    assert rows["--out"].value == "PATH"
    assert (rows["--episode"].value, rows["--episode"].default) == ("INT", "0")


@pytest.mark.skipif(shutil.which("bash") is None, reason="bash is not installed")
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["pl"], {"plan", "play"}),
        (["scene", "im"], {"import"}),
        (["play", "--ev"], {"--every"}),
        (["scene", "import", "--o"], {"--out"}),
        (["generate", "--renderer.det"], {"--renderer.detail"}),
        (["generate", "--robot.cameras"], set()),
        (["scene", "import", "--he"], {"--help", "--help-all"}),
    ],
)
def test_bash_completes(words: list[str], expected: set[str]) -> None:
    typed = " ".join(f"'{word}'" for word in ["readygo", *words])
    ask = f"COMP_WORDS=({typed}); COMP_CWORD={len(words)}; _readygo; printf '%s\\n' \"${{COMPREPLY[@]}}\""
    done = subprocess.run(["bash", "-c", f"{completion(COMMANDS, 'bash')}\n{ask}"], capture_output=True, text=True)
    assert set(done.stdout.split()) == expected, done.stderr


def test_other_shells_have_every_command() -> None:
    fish, zsh = completion(COMMANDS, "fish"), completion(COMMANDS, "zsh")
    assert "bashcompinit" in zsh
    for name in COMMANDS:
        assert f" {name.split()[-1]}\n" in fish
    assert "-l renderer.detail\n" in fish
