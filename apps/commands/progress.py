"""Progress of long commands: a bar on a terminal, and a line every 30 s in a redirected output."""

import time
from collections.abc import Callable
from typing import Any

from rich.progress import BarColumn, Progress, ProgressColumn, TaskID, TaskProgressColumn, TextColumn
from rich.text import Text

from readygo.apps.terminal import PlainConsole

EVERY_S = 30.0
"""Time between two lines [s]."""


class SteadyProgress(Progress):
    """Rich's progress bars on a terminal, elsewhere lines with the same text; the last state is printed at the end."""

    def __init__(
        self,
        *columns: ProgressColumn,
        console: PlainConsole | None = None,
        quiet: bool = False,
        transient: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Make the bars or lines.

        Args:
            columns: Parts of a bar or line; lines have no bars.
            console: Where to print; stderr by default.
            quiet: True prints nothing.
            transient: True removes the bars from the terminal at the end.
            clock: Returns the current time [s].
        """
        console = console or PlainConsole(stderr=True)
        for column in columns:
            # Rich reads a task's text as markup; only the percentage column needs markup.
            if isinstance(column, TextColumn) and not isinstance(column, TaskProgressColumn):
                column.markup = False
        self._lines = not quiet and not console.is_terminal
        super().__init__(*columns, console=console, disable=quiet or self._lines, transient=transient)
        self._spoken = [column for column in columns if not isinstance(column, BarColumn)]
        self._clock, self._said_s, self._said, self._begun = clock, clock(), "", False

    def update(self, task_id: TaskID, **changes: Any) -> None:
        """Change a task's fields, as in rich; print a line if the last one is old enough."""
        super().update(task_id, **changes)
        self._begun = True
        if self._lines and self._clock() - self._said_s >= EVERY_S:
            self._say()

    def stop(self) -> None:
        """End the display, as in rich; print the last state as a line if it is new and there is one."""
        super().stop()
        if self._lines and self._begun:
            self._say()

    def _say(self) -> None:
        tasks = [task for task in self.tasks if task.visible]
        words = [[column(task) for column in self._spoken] for task in tasks]
        said = "; ".join(" ".join(str(word) for word in of_task if isinstance(word, Text)) for of_task in words)
        self._said_s = self._clock()
        if said != self._said:
            self._said = said
            self.console.print(said, markup=False, highlight=False, soft_wrap=True)
