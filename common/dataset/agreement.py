"""Whether shards can be read as one dataset."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from readygo.common.config import section_differences
from readygo.common.dataset.index import ShardIndex
from readygo.common.errors import DatasetError
from readygo.common.images.names import DEPTH, kind_of


def check_alike(shards: Sequence[Path], indexes: Sequence[ShardIndex]) -> None:
    """Raise DatasetError if image sizes, robots (with their cameras), what varies of them, or kinds of depth differ."""

    def sizes(index: ShardIndex) -> list[tuple[int, int]]:
        return sorted({(int(row["height_px"]), int(row["width_px"])) for row in index.episodes})

    first_size, first = sizes(indexes[0])[0], indexes[0].provenance
    deep = [
        (shard, index.provenance.depth)
        for shard, index in zip(shards, indexes, strict=True)
        if any(kind_of(name) == DEPTH for name in index.outputs)
    ]
    for shard, depth in deep:
        if depth != deep[0][1]:
            raise DatasetError(
                f"Depths differ: {deep[0][1]} in {deep[0][0]}, {depth} in {shard}; use them as separate datasets."
            )
    for shard, index in zip(shards, indexes, strict=True):
        for size in sizes(index):
            if size != first_size:
                raise DatasetError(
                    f"Image sizes differ: {first_size[0]}x{first_size[1]} in {shards[0]}, {size[0]}x{size[1]} in "
                    f"{shard}; use them as separate datasets."
                )
        pairs = (("Robots", first.robot, index.provenance.robot), ("Sensors", first.sensor, index.provenance.sensor))
        for what, ours, theirs in pairs:
            if ours != theirs:
                raise DatasetError(
                    f"{what} differ: {_differing(ours, theirs)} in {shards[0]} and {shard}; use them as separate "
                    "datasets."
                )


def _differing(ours: Any, theirs: Any) -> str:
    if ours is None or theirs is None:
        return "only one names its robot"
    return ", ".join(f"{name} {our} and {their}" for name, our, their in section_differences(ours, theirs))
