"""What the expert would do, in the messages of those samples at which it was asked."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from readygo.common.arrays import AnyArray, BoolArray, Float32Array
from readygo.common.errors import DatasetError


def commands_of(messages: Iterable[Any]) -> Float32Array:
    """The commands in messages on /robot/expert_commands: v [m/s], w [rad/s], shape (N, 1 + K, 2).

    Raises:
        DatasetError: If some reach further ahead than others.
    """
    rows = [(message.v_mps, message.w_radps) for message in messages]
    try:
        return np.ascontiguousarray(np.array(rows, dtype=np.float32).transpose(0, 2, 1))
    except ValueError as error:
        raise DatasetError(
            "The expert's commands reach differently far ahead; use the folders as separate datasets."
        ) from error


def spread(rows: AnyArray, asked: BoolArray, missing: float) -> AnyArray:
    """Rows of the samples at which the expert was asked, as rows of all samples.

    Args:
        rows: Shape (N, ...).
        asked: True at N of the samples, shape (S,).
        missing: What stands in the rows of the others.

    Returns:
        Shape (S, ...).
    """
    if asked.all():
        return rows
    filled = np.full((len(asked), *rows.shape[1:]), missing, rows.dtype)
    filled[asked] = rows
    return filled
