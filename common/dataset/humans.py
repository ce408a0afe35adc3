"""Where everybody was, as shards say it with labels or without."""

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


def humans_of_shard(shard: Path) -> list[list[Float64Array]]:
    """Humans at every sample of every episode, in the order of the shard: x, y, z [m], yaw [rad], shape (H, 4) each.

    Raises:
        DatasetError: If the shard is damaged.
    """
    episodes: list[list[Float64Array]] = []
    with map_file(shard) as view:
        for record in iter_records(view):
            if record.opcode != Opcode.CHUNK:
                continue
            span = chunk_span(view, record)
            if not is_intact(view, span):
                raise DatasetError(
                    f"Episode {len(episodes)} of {shard} is damaged: its bytes do not match their CRC-32; "
                    f"see `readygo validate {shard.parent}`."
                )
            found = (m for m in iter_messages(view, span.body, span.end) if m.channel == HUMANS.number)
            poses = (parse(HUMANS, view[message.body : message.end]).poses for message in found)
            episodes.append([np.array([pose_xyzyaw(pose) for pose in each]).reshape(-1, 4) for each in poses])
    return episodes
