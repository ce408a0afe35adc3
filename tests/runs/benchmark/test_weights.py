from pathlib import Path

import pytest

from readygo.runs.benchmark.weights import PARAMETERS, check_weights
from readygo.runs.methods import NETWORKS

torch = pytest.importorskip("torch", reason="torch (extra train) is not installed")


def test_missing_files_are_named_with_their_project_and_place(tmp_path: Path):
    found = check_weights(tmp_path)
    assert [weights.path for weights in found] == [tmp_path / file for file in NETWORKS.values()]
    for weights in found:
        assert weights.sha256 == ""
        assert "github.com/robodhruv/visualnav-transformer" in weights.defect
        assert "\n" not in weights.defect


def test_weights_are_loaded_and_hashed(tmp_path: Path):
    from readygo.common.networks.checkpoint import save_network
    from readygo.common.networks.models import NETWORKS as CLASSES

    network = CLASSES["gnm"]()
    assert sum(p.numel() for p in network.parameters()) == PARAMETERS["gnm"]
    save_network(network, tmp_path / "gnm_large.pth")
    (tmp_path / "vint.pth").write_bytes(b"no weights")
    gnm, vint, _ = check_weights(tmp_path)
    assert gnm.defect == ""
    assert len(gnm.sha256) == 64
    assert "is no checkpoint" in vint.defect
