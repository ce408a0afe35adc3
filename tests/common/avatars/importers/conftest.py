from pathlib import Path

import numpy as np
import pytest

from readygo.common.avatars import load_avatars
from readygo.common.gaussians import save_ply


@pytest.fixture(scope="session")
def bound(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """An embedded avatar as .ply and weights."""
    folder = tmp_path_factory.mktemp("bound")
    avatar = next(iter(load_avatars().values()))
    save_ply(avatar.cloud, folder / "human.ply")
    np.savez(
        folder / "weights.npz",
        lbs_index=avatar.lbs_index,
        lbs_weight=avatar.lbs_weight,
        joints_canonical=avatar.joints_canonical_m,
        joints_tpose=avatar.joints_tpose_m,
        R_canonical_to_tpose=avatar.R_tpose_canonical,
    )
    return folder / "human.ply", folder / "weights.npz"
