import json

import numpy as np
import pytest
import torch

from readygo.services.animator.priormdm.config import PriorMdmConfig
from readygo.services.animator.priormdm.features import FEATURE_COUNT
from tests.services.animator.priormdm.networks import ARGS, random_network


@pytest.fixture
def release(tmp_path):
    """A folder laid out as a user's: weights, args.json, Mean.npy, Std.npy; and a configuration that names them."""
    torch.save(random_network().state_dict(), tmp_path / "model.pt")
    (tmp_path / "args.json").write_text(json.dumps(ARGS))
    rng = np.random.default_rng(4)
    mean = rng.normal(0.0, 0.1, FEATURE_COUNT).astype(np.float32)
    mean[3] = 0.93
    np.save(tmp_path / "Mean.npy", mean)
    np.save(tmp_path / "Std.npy", rng.uniform(0.02, 0.3, FEATURE_COUNT).astype(np.float32))
    config = PriorMdmConfig(
        weights=str(tmp_path / "model.pt"),
        mean=str(tmp_path / "Mean.npy"),
        std=str(tmp_path / "Std.npy"),
        steps=6,
    )
    return tmp_path, config
