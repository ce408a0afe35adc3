"""Pages that open without a network: one HTML file with its style, pictures and charts inside, and no scripts."""

import base64
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

from readygo.apps.pages.style import PAGE_CSS
from readygo.common.drawing.files import Picture, jpeg_bytes, png_bytes


def page(
    title: str,
    subtitle: str,
    *,
    tiles: Sequence[tuple[str, str]],
    sections: Sequence[tuple[str, str]],
    facts: Mapping[str, str],
) -> str:
    """A page as HTML text.

    Args:
        title: Headline.
        subtitle: One or two sentences below it.
        tiles: (value, name) of the numbers on top.
        sections: (heading, HTML) in order; sections without content are left out.
        facts: For the footer.
    """
    shown = "".join(f"<section><h2>{escape(heading)}</h2>{body}</section>" for heading, body in sections if body)
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{PAGE_CSS}</style></head><body><main>"
        f"<header><h1>{escape(title)}</h1><p>{escape(subtitle)}</p>{_tiles(tiles)}</header>"
        f"{shown}{_footer(facts)}</main></body></html>\n"
    )


def table(head: str, rows: str) -> str:
    """A table of rows of HTML."""
    return f'<div class="scroll"><table><thead>{head}</thead><tbody>{rows}</tbody></table></div>'


def figure(source: str, caption: str, *, alt: str) -> str:
    """A picture with a caption."""
    return f'<figure><img src="{source}" alt="{escape(alt)}"><figcaption>{escape(caption)}</figcaption></figure>'


def chart_figure(svg: str, caption: str) -> str:
    """A chart with a caption."""
    return f"<figure>{svg}<figcaption>{escape(caption)}</figcaption></figure>"


def percent(rate: float) -> str:
    """A rate in 0..1 for people to read."""
    return f"{100 * rate:.0f} %"


def jpeg_source(rgb: Picture) -> str:
    """A picture as the source of an image inside of the page, for photographs."""
    return _data_uri("jpeg", jpeg_bytes(rgb))


def png_source(rgb: Picture) -> str:
    """A picture as the source of an image inside of the page, for drawings."""
    return _data_uri("png", png_bytes(rgb))


def webp_source(path: Path) -> str:
    """A file as the source of an animation inside of the page."""
    return _data_uri("webp", path.read_bytes())


def _data_uri(kind: str, data: bytes) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(data).decode('ascii')}"


def _tiles(tiles: Sequence[tuple[str, str]]) -> str:
    items = "".join(f"<li><b>{escape(value)}</b>{escape(name)}</li>" for value, name in tiles)
    return f'<ul class="tiles">{items}</ul>' if items else ""


def _footer(facts: Mapping[str, str]) -> str:
    items = "".join(f"<dt>{escape(name)}</dt><dd>{escape(value)}</dd>" for name, value in facts.items())
    return f"<footer><dl>{items}</dl></footer>" if items else ""
