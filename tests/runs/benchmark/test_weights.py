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


def test_weights_in_folders_of_a_network_are_drivers_of_their_own(tmp_path: Path):
    for place in ("zero-shot", "fine-tuned/0"):
        (tmp_path / "gnm" / place).mkdir(parents=True)
        (tmp_path / "gnm" / place / "gnm_large.pth").write_bytes(b"no weights")
    found = check_weights(tmp_path)
    assert [weights.driver for weights in found] == ["gnm/fine-tuned/0", "gnm/zero-shot", "vint", "nomad"]
    assert [len(weights.sha256) for weights in found] == [64, 64, 0, 0]
    assert found[1].path == tmp_path / "gnm" / "zero-shot" / "gnm_large.pth"
    (tmp_path / "gnm_large.pth").write_bytes(b"no weights")
    assert check_weights(tmp_path)[0].driver == "gnm"
