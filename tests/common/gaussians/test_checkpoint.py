import os
import subprocess
import sys
import zipfile

import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.common.frames import matrix_from_axis_angle
from readygo.common.gaussians import load_gaussians, rgb_of_sh, transform_cloud
from readygo.common.gaussians.checkpoint import load_data_transform
from readygo.common.gaussians.files import read_source
from tests.common.gaussians.other_formats import write_gsplat, write_splatfacto

torch = pytest.importorskip("torch", reason="checkpoints need torch")


def assert_same(read, cloud, atol=1e-6):
    np.testing.assert_allclose(read.means_m, cloud.means_m, atol=atol)
    np.testing.assert_allclose(read.scales_m, cloud.scales_m, rtol=1e-5)
    np.testing.assert_allclose(read.opacities, cloud.opacities, atol=1e-6)
    np.testing.assert_allclose(np.abs((read.quats_wxyz * cloud.quats_wxyz).sum(axis=1)), 1, atol=1e-5)
    np.testing.assert_allclose(read.sh, cloud.sh, atol=10 * atol)


@pytest.mark.parametrize("coefficients", [1, 16])
def test_gsplat_checkpoint_comes_back(tmp_path, make_cloud, coefficients):
    cloud = make_cloud(50, coefficients=coefficients)
    path = write_gsplat(cloud, tmp_path / "last.pt")
    assert read_source(path).kind == "checkpoint of gsplat"
    assert_same(load_gaussians(path), cloud)


def test_all_ranks_of_the_newest_step_are_the_scene(tmp_path, make_cloud):
    parts = [make_cloud(20, seed=k, coefficients=4) for k in range(3)]
    write_gsplat(make_cloud(7, coefficients=4), tmp_path / "ckpts" / "ckpt_6999_rank0.pt")
    for k, part in enumerate(parts):
        write_gsplat(part, tmp_path / "ckpts" / f"ckpt_29999_rank{k}.pt")
    expected = np.concatenate([part.means_m for part in parts])
    for path in (tmp_path, tmp_path / "ckpts", tmp_path / "ckpts" / "ckpt_29999_rank1.pt"):
        np.testing.assert_array_equal(load_gaussians(path).means_m, expected)


def test_nerfstudio_scene_returns_to_the_frame_of_its_data(tmp_path, make_cloud):
    cloud = make_cloud(50, coefficients=9)
    R, t, scale = matrix_from_axis_angle([0.4, -0.2, 1.0]), np.array([1.0, -2.0, 0.5]), 0.3
    trained = transform_cloud(cloud, R, scale * t, scale)
    write_splatfacto(make_cloud(9, coefficients=9), tmp_path, step=2000)
    path = write_splatfacto(trained, tmp_path, R=R, t=t, scale=scale)
    for place in (tmp_path, tmp_path / "nerfstudio_models", path):
        assert_same(load_gaussians(place), cloud, atol=1e-5)
    source = read_source(tmp_path)
    assert source.kind == "checkpoint of nerfstudio"
    np.testing.assert_allclose(source.up, R.T @ [0, 0, 1], atol=1e-6)
    (tmp_path / "dataparser_transforms.json").unlink()
    assert_same(load_gaussians(tmp_path), trained, atol=1e-5)
    assert read_source(tmp_path).up is None


def test_splatfacto_without_view_dependence_stores_logits_of_colours(tmp_path, make_cloud):
    cloud = make_cloud(30)
    path = write_splatfacto(cloud, tmp_path)
    expected = rgb_of_sh(cloud.sh[:, 0]).clip(0, 1)
    np.testing.assert_allclose(rgb_of_sh(load_gaussians(path).sh[:, 0]), expected, atol=1e-5)


def test_older_splatfacto_keeps_its_parameters_in_the_model(tmp_path, make_cloud):
    cloud = make_cloud(10, coefficients=4)
    path = write_splatfacto(cloud, tmp_path)
    state = torch.load(path, weights_only=False)
    state["pipeline"] = {name.replace("gauss_params.", ""): value for name, value in state["pipeline"].items()}
    torch.save(state, path)
    assert_same(load_gaussians(path), cloud)


class Evil:
    def __reduce__(self):
        return os.mkdir, ("evil",)


def _evil(cloud, path):
    write_gsplat(cloud, path, more=Evil())


def _repeated(cloud, path):
    splats = torch.load(write_gsplat(cloud, path))["splats"]
    splats["means"] = torch.zeros(1, 1).expand(10**12, 3)
    torch.save({"splats": splats}, path)


def _inflating(cloud, path):
    write_gsplat(cloud, path)
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("data/bomb", bytes(10**7))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (_evil, "not a checkpoint of plain tensors"),
        (_repeated, "more than the file holds"),
        (_inflating, "claims to unpack"),
        (lambda cloud, path: write_gsplat(cloud, path, quats=torch.zeros(3, 4)), "make no Gaussians"),
        (lambda cloud, path: write_gsplat(cloud, path, shN=torch.zeros(10, 2, 3)), "make no Gaussians"),
        (lambda cloud, path: write_gsplat(cloud, path, means=torch.zeros(0, 3)), "make no Gaussians"),
        (lambda cloud, path: write_gsplat(cloud, path, scales=[1.0]), "no tensor 'scales'"),
        (lambda cloud, path: write_gsplat(cloud, path, means=torch.zeros(10, 3).to_sparse()), "no tensor 'means'"),
        (lambda cloud, path: write_gsplat(cloud, path, sh0=None, colors=torch.zeros(10, 3)), "appearance embeddings"),
        (lambda cloud, path: torch.save({"model": {}}, path), r"only \['model'\]"),
        (lambda cloud, path: torch.save((1, 2), path), "holds a tuple"),
        (lambda cloud, path: path.write_bytes(write_gsplat(cloud, path).read_bytes()[:-30]), "truncated or damaged"),
    ],
)
def test_hostile_and_foreign_checkpoints_are_refused_unrun(tmp_path, make_cloud, monkeypatch, make, message):
    monkeypatch.chdir(tmp_path)
    make(make_cloud(10), tmp_path / "a.pt")
    with pytest.raises(SceneError, match=message) as refusal:
        read_source(tmp_path / "a.pt")
    assert "\n" not in str(refusal.value)
    assert not (tmp_path / "evil").exists()


def test_archive_that_is_no_checkpoint_is_named(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("meta.json", "{}")
    with pytest.raises(SceneError, match="zip archive without a torch checkpoint"):
        read_source(tmp_path / "a.zip")


def test_missing_torch_is_named_with_the_command_that_installs_it(tmp_path, make_cloud):
    path = write_gsplat(make_cloud(5), tmp_path / "a.pt")
    code = (
        "import sys; sys.modules['torch'] = None\n"
        "from readygo.common.errors import SceneError\n"
        "from readygo.common.gaussians import load_gaussians\n"
        f"try: load_gaussians({str(path)!r})\nexcept SceneError as error: sys.stdout.write(str(error))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "which torch reads; run: " in run.stdout
    assert "pip install" in run.stdout


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]", "cannot be used"),
        ('{"transform": [[1]], "scale": 1}', "cannot be used"),
        ('{"transform": [[1,0,0,0],[0,1,0,0],[0,0,1,0]], "scale": 0}', "positive scale"),
        ('{"transform": [[1,0,0,0],[0,1,0,0],[0,0,NaN,0]], "scale": 1}', "positive scale"),
        ('{"transform": [[1,0,0,0],[0,1,0,0],[0,0,-1,0]], "scale": 1}', "rotation"),
        ("{", "cannot be used"),
    ],
)
def test_broken_transforms_are_refused(tmp_path, text, message):
    (tmp_path / "a.json").write_text(text)
    with pytest.raises(SceneError, match=message):
        load_data_transform(tmp_path / "a.json")
