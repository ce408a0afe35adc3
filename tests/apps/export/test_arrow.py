import json
from pathlib import Path

import numpy as np
import pytest

from readygo.apps.export.arrow import feature_of, table_of, write_tables

pq = pytest.importorskip("pyarrow.parquet", reason="pyarrow (extra export) is not installed")


def test_columns_are_named_as_datasets_does() -> None:
    assert feature_of(np.zeros(2, np.float32)) == {"dtype": "float32", "_type": "Value"}
    assert feature_of(np.zeros((2, 3), np.int64))["length"] == 3
    assert feature_of([b"jpeg"]) == {"_type": "Image"}
    assert feature_of(["text"]) == {"dtype": "string", "_type": "Value"}


def test_tables_come_back_from_one_file(tmp_path: Path) -> None:
    tables = [table_of({"a": np.full((2, 2), n), "image": [b"x", b"y"], "name": ["u", "v"]}) for n in (1, 2)]
    write_tables(tmp_path / "a.parquet", tables)
    read = pq.read_table(tmp_path / "a.parquet")
    assert read.column("a").to_pylist() == [[1, 1], [1, 1], [2, 2], [2, 2]]
    assert read.column("image")[1].as_py() == {"bytes": b"y", "path": None}
    assert json.loads(read.schema.metadata[b"huggingface"])["info"]["features"]["image"] == {"_type": "Image"}
