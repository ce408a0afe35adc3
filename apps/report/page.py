"""Self-contained pages: one HTML file with style, images, videos and charts inside, without scripts.

A page is a list of sections, a section a list of blocks. A block is data; the macro of the same name in
`templates/blocks.html` draws it. Jinja2 escapes all text; blocks within blocks and in cells of tables draw themselves.
"""

import base64
import functools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from readygo.common.arrays import UInt8Array
from readygo.common.drawing.files import jpeg_bytes, png_bytes
from readygo.common.drawing.plan_view import Rgb

if TYPE_CHECKING:
    from jinja2 import Environment


class Block:
    """A part of a page."""

    def __html__(self) -> str:
        """The block as HTML, by its macro: `draw_meter` for `Meter`; templates call this method."""
        words = re.findall(r"[A-Z][a-z]*", type(self).__name__)
        return draw("blocks.html", "_".join(["draw", *words]).lower(), self)


@dataclass(frozen=True, kw_only=True)
class Paragraph(Block):
    """A paragraph of text, with links behind it."""

    text: str
    links: Sequence["PageLink"] = ()
    is_note: bool = False
    """True for small print."""


@dataclass(frozen=True, kw_only=True)
class PageLink:
    """A link to a file beside the page."""

    href: str
    """Path relative to the page's folder, unquoted."""
    what: str
    """Text of the link."""


@dataclass(frozen=True)
class Subheading(Block):
    """A heading within a section."""

    text: str


@dataclass(frozen=True)
class PageTable(Block):
    """A table; on narrow screens every row is a card, whose lines name their columns."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str | Block]]
    """Rows with a cell per column; cards leave empty cells out."""
    text_columns: int = 1
    """Number of columns with text, the first ones; those behind have numbers, which are aligned at the right."""


@dataclass(frozen=True)
class Estimate(Block):
    """A value in bold with its interval behind it."""

    value: str
    interval: str = ""


@dataclass(frozen=True)
class Meter(Block):
    """A share in 0..1 as a filled bar, with its interval as a line on it."""

    share: float
    interval: tuple[float, float] | None = None
    """Lower and upper end, 0..1."""


@dataclass(frozen=True, kw_only=True)
class RateRow(Block):
    """A name, a bar and a rate in percent."""

    name: str
    meter: Meter
    stands_out: bool = False


@dataclass(frozen=True, kw_only=True)
class MediaFigure(Block):
    """An image, a video or a chart with a caption. One of `image`, `video` and `chart` is given."""

    caption: str
    image: str = ""
    """Source of an image."""
    alt: str = ""
    """Text instead of the image."""
    video: str = ""
    """Source of a video."""
    plays: bool = False
    """True if the video plays automatically in a loop."""
    chart: str = ""
    """An SVG element of `readygo.common.drawing.charts`."""


@dataclass(frozen=True, kw_only=True)
class Arrangement(Block):
    """Blocks side by side if there is room ("pair"), images in a grid ("strip"), or one below the other ("stack")."""

    kind: Literal["pair", "strip", "stack"]
    blocks: Sequence[Block]


@dataclass(frozen=True, kw_only=True, eq=False)
class StripImage:
    """One image of a strip of the robot's camera images."""

    time_s: float
    """Simulated time since the episode began [s]."""
    rgb: UInt8Array
    """Pixels, shape (H, W, 3)."""


@dataclass(frozen=True)
class ColourLegend(Block):
    """Names of the colours of a picture."""

    entries: Sequence[tuple[str, Rgb]]


@dataclass(frozen=True, kw_only=True)
class Details(Block):
    """A block below a line that opens it."""

    summary: str
    block: Block


@dataclass(frozen=True, kw_only=True)
class CommandLine(Block):
    """A command line, with a description above."""

    line: str
    what: str = ""


def page(
    title: str,
    subtitle: str,
    *,
    tiles: Sequence[tuple[str, str]],
    sections: Mapping[str, Sequence[Block]],
    facts: Mapping[str, str],
    hero: Block | None = None,
) -> str:
    """A page as HTML text.

    Args:
        title: Headline.
        subtitle: Introduction in a few sentences.
        tiles: (value, name) of the numbers on top.
        sections: Blocks by heading, in order; sections without blocks are left out.
        facts: Facts for the footer by name.
        hero: Block at the top, such as a video.
    """
    template = _environment().get_template("page.html")
    shown = {heading: blocks for heading, blocks in sections.items() if blocks}
    return template.render(title=title, subtitle=subtitle, tiles=tiles, sections=shown, facts=facts, hero=hero)


def draw(template: str, macro: str, *data: Any, **named: Any) -> str:
    """Text of a macro of a template: HTML, or Markdown of an .md file.

    Args:
        template: File in `templates`.
        macro: Name of the macro.
        data: Positional arguments of the macro.
        named: Arguments of the macro by name.
    """
    return str(getattr(_environment().get_template(template).module, macro)(*data, **named))


def small_print(text: str, links: Sequence[PageLink] = ()) -> Paragraph:
    """A paragraph of small print."""
    return Paragraph(text=text, links=links, is_note=True)


def fact_table(rows: Sequence[tuple[str, str]]) -> PageTable:
    """A table of facts: name and value."""
    return PageTable(("What", "Value"), rows, text_columns=2)


def rejections(counts: Mapping[str, int], recorded: int) -> PageTable:
    """A table of the episodes that are not recorded.

    Args:
        counts: Rejected episodes by reason.
        recorded: Number of recorded episodes.
    """
    tried = recorded + sum(counts.values())
    rows = [
        [reason.replace("_", " "), f"{count:,}", percent(count / max(tried, 1))]
        for reason, count in sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    ]
    columns = (f"Not recorded, of {tried:,} tried", "Episodes", "Share")
    return PageTable(columns, rows or [["none", "0", "0 %"]])


def image_strip(images: Sequence[StripImage]) -> list[Block]:
    """A strip of camera images with their times; an empty list without any."""
    figures = [
        photograph(image.rgb, f"{image.time_s:.2f} s", alt=f"Robot's view after {image.time_s:.2f} s")
        for image in images
    ]
    return arrange_blocks("strip", figures)


def arrange_blocks(kind: Literal["pair", "strip", "stack"], blocks: Sequence[Block | None]) -> list[Block]:
    """The blocks that there are in one arrangement; an empty list without any."""
    given = [block for block in blocks if block is not None]
    return [Arrangement(kind=kind, blocks=given)] if given else []


def photograph(rgb: UInt8Array, caption: str, *, alt: str = "") -> MediaFigure:
    """A figure with a JPEG image inside of the page."""
    return MediaFigure(image=_data_uri("image/jpeg", jpeg_bytes(rgb)), caption=caption, alt=alt or caption)


def drawing(rgb: UInt8Array, caption: str, *, alt: str = "") -> MediaFigure:
    """A figure with a PNG image inside of the page: a map or a drawing."""
    return MediaFigure(image=_data_uri("image/png", png_bytes(rgb)), caption=caption, alt=alt or caption)


def film(path: Path, caption: str, *, plays: bool = False) -> MediaFigure:
    """A figure with a video inside of the page.

    Args:
        path: Path of a .webm file.
        caption: Text below the video.
        plays: True if the video plays automatically in a loop.
    """
    return MediaFigure(video=_data_uri("video/webm", path.read_bytes()), caption=caption, plays=plays)


def percent(rate: float) -> str:
    """A rate in 0..1 as text in percent."""
    return f"{100 * rate:.0f} %"


def _data_uri(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


@functools.cache
def _environment() -> "Environment":
    # Imported with the first page: most commands draw none.
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent / "templates"),
        # Markdown is no HTML: its only template, of a card, has text of the dataset alone.
        autoescape=lambda name: name is None or not name.endswith(".md"),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        auto_reload=False,
    )
    environment.filters["percent"] = percent
    environment.filters["width"] = lambda share: f"{100 * min(max(share, 0.0), 1.0):.1f}%"
    return environment
