"""Rows as Arrow tables, with the metadata by which Hugging Face's `datasets` distinguishes images from bytes.

pyarrow belongs to the extra `export`, and is imported where it is used.
"""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.common.errors import DatasetError
from readygo.common.files import write_then_rename

ROW_GROUP = 256
"""Rows per Parquet row group: readers hold the images of one group in memory."""
Column = npt.NDArray[np.generic] | list[bytes] | list[str]


def feature_of(column: Column) -> dict[str, Any]:
    """The feature of a column in `datasets`: arrays by dtype and width, bytes as images, text as strings."""
    if isinstance(column, list):
        return {"_type": "Image"} if isinstance(column[0], bytes) else {"dtype": "string", "_type": "Value"}
    value = {"dtype": str(column.dtype), "_type": "Value"}
    return value if column.ndim == 1 else {"feature": value, "length": column.shape[1], "_type": "Sequence"}


def table_of(columns: Mapping[str, Column]) -> Any:
    """An Arrow table from columns of equal length."""
    import pyarrow as pa

    features = {name: feature_of(column) for name, column in columns.items()}
    table = pa.table({name: _array(column) for name, column in columns.items()})
    return table.replace_schema_metadata({"huggingface": json.dumps({"info": {"features": features}})})


def write_tables(path: Path, tables: Iterable[Any]) -> int:
    """Write tables of one schema, one after the other, to one Parquet file; returns its size [bytes].

    Raises:
        DatasetError: If the file cannot be written.
    """
    import pyarrow.parquet as pq

    writer: Any = None
    with write_then_rename(path, raises=DatasetError) as part:
        for table in tables:
            writer = writer or pq.ParquetWriter(part, table.schema, compression="snappy")
            writer.write_table(table, row_group_size=ROW_GROUP)
        writer.close()
    return path.stat().st_size


def _array(column: Column) -> Any:
    import pyarrow as pa

    if not isinstance(column, list):
        flat = pa.array(np.ascontiguousarray(column).reshape(-1))
        return flat if column.ndim == 1 else pa.FixedSizeListArray.from_arrays(flat, column.shape[1])
    if isinstance(column[0], str):
        return pa.array(column, pa.string())
    images = [{"bytes": image, "path": None} for image in column]
    return pa.array(images, pa.struct({"bytes": pa.binary(), "path": pa.string()}))
