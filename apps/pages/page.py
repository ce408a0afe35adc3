"""Self-contained pages: one HTML file with style, pictures, videos and charts inside, without scripts."""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Literal

from readygo.apps.pages.style import PAGE_CSS
from readygo.common.drawing.files import Picture, jpeg_bytes, png_bytes
from readygo.common.drawing.plan_view import Rgb


@dataclass(frozen=True)
class Column:
    """A column of a table."""

    name: str
    kind: Literal["", "n", "wide"] = ""
    """Kind of the column: "n" for numbers, "wide" for long text, "" for other text."""


def page(
    title: str,
    subtitle: str,
    *,
    hero: str = "",
    tiles: Sequence[tuple[str, str]],
    sections: Sequence[tuple[str, str]],
    facts: Mapping[str, str],
) -> str:
    """A page as HTML text.

    Args:
        title: Headline.
        subtitle: Introduction in a few sentences.
        hero: HTML at the top, such as a video.
        tiles: (value, name) of the numbers on top.
        sections: (heading, HTML) in order; sections without content are left out.
        facts: Facts for the footer by name.
    """
    shown = "".join(f"<section><h2>{escape(heading)}</h2>{body}</section>" for heading, body in sections if body)
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{PAGE_CSS}</style></head><body><main>"
        f"<header><h1>{escape(title)}</h1><p>{escape(subtitle)}</p></header>"
        f"{hero}{_tiles(tiles)}"
        f"{shown}{_footer(facts)}</main></body></html>\n"
    )


def table(columns: Sequence[Column], rows: Sequence[Sequence[str]]) -> str:
    """A table of cells of HTML; on narrow screens every row is a card, whose lines name their columns.

    Args:
        columns: Columns from left to right.
        rows: Rows with a cell per column; cards leave empty cells out.
    """
    head = "".join(f"<th{_kind(column)}>{escape(column.name)}</th>" for column in columns)
    body = "".join(f"<tr>{_cells(columns, row)}</tr>" for row in rows)
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _cells(columns: Sequence[Column], row: Sequence[str]) -> str:
    return "".join(
        f'<td{_kind(column)} data-name="{escape(column.name)}">{cell}</td>'
        for column, cell in zip(columns, row, strict=True)
    )


def _kind(column: Column) -> str:
    return f" class={column.kind}" if column.kind else ""


def rejections(counts: Mapping[str, int], recorded: int) -> str:
    """A table of the episodes that are not recorded.

    Args:
        counts: Rejected episodes by reason.
        recorded: Number of recorded episodes.
    """
    tried = recorded + sum(counts.values())
    columns = (Column(f"Not recorded, of {tried:,} tried", "wide"), Column("Episodes", "n"), Column("Share", "n"))
    rows = [
        [escape(reason.replace("_", " ")), f"{count:,}", percent(count / tried)]
        for reason, count in sorted(counts.items(), key=lambda item: (-item[1], item[0]))
    ]
    return table(columns, rows or [["none", "0", "0 %"]])


def details(summary: str, body: str) -> str:
    """A collapsible section."""
    return f"<details><summary>{escape(summary)}</summary>{body}</details>"


def legend(entries: Sequence[tuple[str, Rgb]]) -> str:
    """A legend of a picture's colours."""
    items = "".join(
        f'<li><i style="background:rgb({colour[0]},{colour[1]},{colour[2]})"></i>{escape(name)}</li>'
        for name, colour in entries
    )
    return f'<ul class="legend">{items}</ul>'


def figure(source: str, caption: str, *, alt: str) -> str:
    """A picture with a caption."""
    return f'<figure><img src="{source}" alt="{escape(alt)}"><figcaption>{escape(caption)}</figcaption></figure>'


def film_figure(path: Path, caption: str, *, runs: bool = False) -> str:
    """A video inside of the page with a caption.

    Args:
        path: Path of a .webm file.
        caption: Text below the video.
        runs: True if the video plays automatically in a loop.
    """
    source = _data_uri("video/webm", path.read_bytes())
    plays = "autoplay loop" if runs else 'preload="auto"'
    return (
        f'<figure class="film"><video src="{source}" controls muted playsinline {plays}></video>'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def chart_figure(svg: str, caption: str) -> str:
    """A chart with a caption."""
    return f"<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>"


def percent(rate: float) -> str:
    """A rate in 0..1 as text in percent."""
    return f"{100 * rate:.0f} %"


def jpeg_source(rgb: Picture) -> str:
    """A picture as the source of an image inside of the page, for photographs."""
    return _data_uri("image/jpeg", jpeg_bytes(rgb))


def png_source(rgb: Picture) -> str:
    """A picture as the source of an image inside of the page, for drawings."""
    return _data_uri("image/png", png_bytes(rgb))


def _data_uri(kind: str, data: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode('ascii')}"


def _tiles(tiles: Sequence[tuple[str, str]]) -> str:
    items = "".join(f"<li><b>{escape(value)}</b>{escape(name)}</li>" for value, name in tiles)
    return f'<ul class="tiles">{items}</ul>' if items else ""


def _footer(facts: Mapping[str, str]) -> str:
    items = "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in facts.items())
    return f"<footer><dl>{items}</dl></footer>" if items else ""
