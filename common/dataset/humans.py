"""Where everybody was, as shards say it with labels or without."""

from itertools import islice
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode

from readygo.common.arrays import Float64Array
from readygo.common.dataset.chunk import parse
from readygo.common.dataset.index import map_file
from readygo.common.dataset.poses import pose_xyzyaw
from readygo.common.dataset.records import chunk_span, is_intact, iter_messages, iter_records
from readygo.common.dataset.schemas import HUMANS
from readygo.common.errors import DatasetError


def humans_of_shard(shard: Path, only: int | None = None) -> list[list[Float64Array]]:
    """Humans at every sample of every episode, in the order of the shard: x, y, z [m], yaw [rad], shape (H, 4) each.

    Args:
        shard: The file.
        only: Number of the only episode to read; None reads all.

    Raises:
        DatasetError: If what is read is damaged.
    """
    episodes: list[list[Float64Array]] = []
    with map_file(shard) as view:
        chunks = (record for record in iter_records(view) if record.opcode == Opcode.CHUNK)
        first = only or 0
        for number, record in enumerate(islice(chunks, first, None if only is None else only + 1), first):
            span = chunk_span(view, record)
            if not is_intact(view, span):
                raise DatasetError(
                    f"Episode {number} of {shard} is damaged: its bytes do not match their CRC-32; "
                    f"see `readygo validate {shard.parent}`."
                )
            found = (m for m in iter_messages(view, span.body, span.end) if m.channel == HUMANS.number)
            poses = (parse(HUMANS, view[message.body : message.end]).poses for message in found)
            episodes.append([np.array([pose_xyzyaw(pose) for pose in each]).reshape(-1, 4) for each in poses])
    return episodes
