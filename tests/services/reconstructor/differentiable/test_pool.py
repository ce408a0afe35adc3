import numpy as np
import torch

from readygo.services.reconstructor.differentiable.pool import ArrayPool


def test_memory_is_used_again_only_when_nobody_holds_it() -> None:
    pool = ArrayPool()
    first = pool.take("x", 1000, np.float32)
    place = first.ctypes.data
    view = first.reshape(10, 100)[2:]
    del first
    second = pool.take("x", 1000, np.float32)
    assert second.ctypes.data != place
    tensor = torch.from_numpy(view)
    del view
    assert pool.take("x", 1000, np.float32).ctypes.data not in (place, second.ctypes.data)
    del tensor
    assert pool.take("x", 900, np.float32).ctypes.data == place
