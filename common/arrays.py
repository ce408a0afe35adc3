"""Types of NumPy arrays, one name per dtype; shapes and units stand in the docstrings of what has them."""

from typing import Any

import numpy as np
import numpy.typing as npt

Float64Array = npt.NDArray[np.float64]
Float16Array = npt.NDArray[np.float16]
Float32Array = npt.NDArray[np.float32]
FloatingArray = npt.NDArray[np.floating]
"""Of any floating-point dtype."""
BoolArray = npt.NDArray[np.bool_]
UInt8Array = npt.NDArray[np.uint8]
UInt16Array = npt.NDArray[np.uint16]
UInt32Array = npt.NDArray[np.uint32]
UInt64Array = npt.NDArray[np.uint64]
Int8Array = npt.NDArray[np.int8]
Int16Array = npt.NDArray[np.int16]
Int32Array = npt.NDArray[np.int32]
Int64Array = npt.NDArray[np.int64]
RecordArray = npt.NDArray[np.void]
"""Of a dtype with named fields."""
AnyArray = npt.NDArray[Any]
