import io

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn

from readygo.apps.commands.progress import EVERY_S, SteadyProgress
from readygo.apps.terminal import PlainConsole
from tests.clock import Clock


def progress(file: io.StringIO, clock: Clock, *, quiet: bool = False, terminal: bool = False) -> SteadyProgress:
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[said]}"))
    console = PlainConsole(file=file, force_terminal=terminal, width=100)
    return SteadyProgress(*columns, console=console, quiet=quiet, clock=clock)


def drive(file: io.StringIO, *, quiet: bool = False, terminal: bool = False) -> None:
    clock = Clock()
    with progress(file, clock, quiet=quiet, terminal=terminal) as bar:
        task = bar.add_task("episodes", total=9, said="")
        bar.add_task("hidden", total=1, said="", visible=False)
        for done in range(10):
            clock.now_s += 0.4 * EVERY_S
            bar.update(task, completed=done, said=f"{done} ok")


def test_a_file_gets_a_line_now_and_then_and_the_last_state() -> None:
    file = io.StringIO()
    drive(file)
    lines = ["episodes 2/9 2 ok", "episodes 5/9 5 ok", "episodes 8/9 8 ok", "episodes 9/9 9 ok"]
    assert file.getvalue().splitlines() == lines


def test_a_file_gets_nothing_of_work_that_fails_before_it_begins() -> None:
    file = io.StringIO()
    with progress(file, Clock()) as bar:
        bar.add_task("episodes", total=9, said="")
    assert file.getvalue() == ""


def test_quiet_says_nothing() -> None:
    file = io.StringIO()
    drive(file, quiet=True)
    assert file.getvalue() == ""


def test_a_terminal_gets_a_bar() -> None:
    file = io.StringIO()
    drive(file, terminal=True)
    assert "━" in file.getvalue()


def test_what_a_task_says_is_no_markup() -> None:
    file = io.StringIO()
    with progress(file, Clock(), terminal=True) as bar:
        bar.add_task("[/x]", total=1, said="\x1b]0;title\x07[link=evil]")
    assert "[/x]" in file.getvalue()
    assert "]0;title[link=evil]" in file.getvalue()
    assert "\x1b]0;" not in file.getvalue()
