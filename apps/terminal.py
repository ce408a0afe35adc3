"""A console that prints text literally: names and errors from files or peers are never read as markup or controls."""

from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType  # noqa: TID251
from rich.segment import Segment

from readygo.common.printable import strip_controls


class PlainConsole(Console):
    """Rich's console without markup, emoji codes and automatic colours; control characters are removed."""

    def __init__(self, **settings: Any) -> None:
        """Make the console; `settings` are those of rich's."""
        super().__init__(**{"markup": False, "emoji": False, "highlight": False, **settings})

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Segments without control characters; rich's control segments stay."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(strip_controls(segment.text), segment.style)
