import numpy as np
import pytest

from readygo.services.reconstructor.differentiable.memory import allocate_aligned


@pytest.mark.parametrize(("count", "dtype"), [(1, np.int64), (77, np.uint16), (1000, np.float32)])
def test_array_begins_on_a_cache_line_and_holds_what_is_asked_for(count: int, dtype: type) -> None:
    arrays = [allocate_aligned(count, dtype) for _ in range(5)]
    for number, array in enumerate(arrays):
        assert (array.ctypes.data % 64, len(array), array.dtype) == (0, count, dtype)
        array[:] = number
    assert all((array == number).all() for number, array in enumerate(arrays))
