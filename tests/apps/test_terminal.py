import io

import pytest
from rich.live import Live
from rich.table import Table
from rich.text import Text

from readygo.apps.terminal import PlainConsole


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("[/x]", "[/x]"),
        ("[link=http://evil.example]here[/link]", "[link=http://evil.example]here[/link]"),
        (":warning:", ":warning:"),
        ("\x1b]0;title\x07", "]0;title"),
        ("a\x1b[2Jb\x9b2J", "a[2Jb2J"),
    ],
)
def test_text_is_shown_as_it_is_and_steers_nothing(text: str, shown: str) -> None:
    console = PlainConsole(file=io.StringIO(), width=80)
    table = Table(text)
    table.add_row(text)
    for what in (text, Text(text), table):
        console.print(what)
    said = console.file.getvalue()  # type: ignore[attr-defined]
    assert said.count(shown) == 4
    assert "\x1b" not in said


def test_rich_itself_still_draws_on_a_terminal() -> None:
    console = PlainConsole(file=io.StringIO(), width=80, force_terminal=True, color_system="standard")
    with Live(Text("red", "red"), console=console, auto_refresh=False) as live:
        live.update(Text("\x1b[2Jred", "red"), refresh=True)
    said = console.file.getvalue()  # type: ignore[attr-defined]
    assert "\x1b[31m[2Jred\x1b[0m" in said
    assert "\x1b[?25l" in said, "the cursor is hidden meanwhile"
