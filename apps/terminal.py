"""A console that shows text as it is: names, reasons and errors that others chose are no markup and steer nothing."""

from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType  # noqa: TID251
from rich.segment import Segment

from readygo.common.printable import strip_controls


class PlainConsole(Console):
    """Rich's console without markup, emoji codes and colours of its own choice; control characters are left out."""

    def __init__(self, **settings: Any) -> None:
        """Make it; `settings` are those of rich's."""
        super().__init__(**{"markup": False, "emoji": False, "highlight": False, **settings})

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Segments of what is shown; rich's own control segments stay."""
        for segment in super().render(renderable, options):
            yield segment if segment.control else Segment(strip_controls(segment.text), segment.style)
