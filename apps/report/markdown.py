"""Blocks of a page as Markdown."""

from collections.abc import Sequence

from readygo.apps.report.page import Block, Estimate, PageTable, Subheading


def markdown_lines(block: Block) -> list[str]:
    """A table, a heading or a paragraph as lines of Markdown."""
    if isinstance(block, PageTable):
        align = [" --- " if k < block.text_columns else " ---: " for k in range(len(block.columns))]
        rows = [[_plain(cell) for cell in row] for row in block.rows]
        return [_line(block.columns), f"|{'|'.join(align)}|", *map(_line, rows)]
    if isinstance(block, Subheading):
        return [f"### {block.text}"]
    return [getattr(block, "text", "")]


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"


def _plain(cell: str | Block) -> str:
    if isinstance(cell, Estimate):
        return f"{cell.value} ({cell.interval})" if cell.interval else cell.value
    return str(cell)
