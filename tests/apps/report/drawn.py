"""Blocks as HTML."""

from collections.abc import Sequence

from readygo.apps.report.page import Block


def html_of(blocks: Sequence[Block]) -> str:
    """The HTML of blocks, one after the other."""
    return "\n".join(block.__html__() for block in blocks)
