import hashlib
from pathlib import Path

import pytest

from readygo.apps.fleet.evaluation import make_plan
from readygo.common.errors import RunError
from readygo.common.messages import Split
from readygo.runs.evaluation import make_request
from readygo.runs.method_files import check_method_files, method_hashes
from readygo.runs.policy import policy_sha256
from tests.common.policy.artifacts import write_policy
from tests.common.state_policy.state_policies import write_state_policy


def test_files_of_methods_have_hashes_and_built_in_ones_none(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("class A: ...\n")
    (tmp_path / "gnm_large.pth").write_bytes(b"weights")
    mine = f"{tmp_path / 'mine.py'}:A"
    hashes = method_hashes(
        ["expert", "straight-line", mine, "gnm", "vint", "vid2sim", "json:loads", "nowhere:A"], tmp_path
    )
    assert hashes[mine] == hashlib.sha256(b"class A: ...\n").hexdigest()
    assert hashes["gnm"] == hashlib.sha256(b"weights").hexdigest()
    assert set(hashes) == {mine, "gnm", "json:loads"}


def test_weights_of_a_network_below_its_name_have_a_hash(tmp_path: Path) -> None:
    (tmp_path / "gnm" / "fine-tuned").mkdir(parents=True)
    (tmp_path / "gnm" / "fine-tuned" / "gnm_large.pth").write_bytes(b"weights")
    hashes = method_hashes(["gnm/fine-tuned", "gnm/zero-shot"], tmp_path)
    assert hashes == {"gnm/fine-tuned": hashlib.sha256(b"weights").hexdigest()}


def test_further_policies_have_the_hash_of_the_policy(tmp_path: Path) -> None:
    mesh, run = write_policy(tmp_path / "vid2sim"), write_policy(tmp_path / "run" / "policy")
    assert method_hashes(["vid2sim", "run"], tmp_path) == {"vid2sim": policy_sha256(mesh), "run": policy_sha256(run)}
    (run / "policy.onnx").write_bytes(b"others")
    with pytest.raises(RunError, match="run is another one here"):
        check_method_files({"run": policy_sha256(mesh)}, ["run"], tmp_path)


def test_method_that_differs_or_lacks_here_is_refused(tmp_path: Path) -> None:
    (tmp_path / "gnm_large.pth").write_bytes(b"weights")
    hashes = method_hashes(["gnm"], tmp_path)
    check_method_files(hashes, ["gnm", "expert"], tmp_path)
    (tmp_path / "gnm_large.pth").write_bytes(b"others")
    with pytest.raises(RunError, match="gnm is another one here"):
        check_method_files(hashes, ["gnm"], tmp_path)
    (tmp_path / "gnm_large.pth").unlink()
    with pytest.raises(RunError, match="gnm is not on this machine"):
        check_method_files(hashes, ["gnm"], tmp_path)


def test_state_policies_have_the_hashes_of_their_files(tmp_path: Path) -> None:
    folder = write_state_policy(tmp_path / "rl")
    hashes = method_hashes(["rl"], tmp_path)
    check_method_files(hashes, ["rl"], tmp_path)
    (folder / "actor.npz").write_bytes(b"others")
    with pytest.raises(RunError, match="rl is another one here"):
        check_method_files(hashes, ["rl"], tmp_path)


def test_methods_of_several_files_have_one_hash_that_workers_accept(tmp_path: Path) -> None:
    write_state_policy(tmp_path / "rl")
    (tmp_path / "perception").mkdir()
    for name in ("perception.toml", "perception.onnx"):
        (tmp_path / "perception" / name).write_bytes(b"as trained")
    methods = ("rl", "perceive-and-act", "perceive-and-plan")
    hashes = method_hashes(methods, tmp_path)
    assert set(hashes) == set(methods)
    request = make_request(1, ("dynamic",), methods, Split.TEST, 0)
    plan = make_plan(request, camera="policy", lockstep=8, checkpoints=tmp_path, method_hashes=hashes)
    assert plan.method_hashes == hashes
    for folder, name, same in (
        ("perception", "perception.onnx", [True, False, False]),
        ("perception", "perception.toml", [True, False, False]),
        ("rl", "state_policy.toml", [False, False, True]),
        ("rl", "actor.npz", [False, False, True]),
    ):
        file = tmp_path / folder / name
        before = file.read_bytes()
        file.write_bytes(b"another")
        changed = method_hashes(methods, tmp_path)
        assert [changed[method] == hashes[method] for method in methods] == same
        file.write_bytes(before)
