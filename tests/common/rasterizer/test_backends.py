import dataclasses
import importlib.util
from pathlib import Path

import numpy as np
import pytest

from readygo.common.avatars import Avatar
from readygo.common.avatars.file import avatar_hash
from readygo.common.errors import ReadygoError
from readygo.common.gaussians import GaussianCloud
from readygo.common.rasterizer import backends
from readygo.common.rasterizer.backends import StaticCloud, make_rasterizer, packed_avatars
from readygo.common.rasterizer.interface import View
from readygo.common.robot import CameraConfig

CAMERA = CameraConfig(height_px=24, width_px=40)
VIEW = View(T_world_camera=CAMERA.T_world_camera(-5.0, 0.0, 0.1, 0.8))


@pytest.fixture(scope="module")
def cloud(make_cloud) -> GaussianCloud:
    return make_cloud(300)


def still(cloud: GaussianCloud) -> StaticCloud:
    return StaticCloud(key="c0ffee-scene", load=lambda: cloud)


def test_backends_that_are_one_draw_the_same(cloud: GaussianCloud, avatar: Avatar, tmp_path: Path) -> None:
    images = [
        make_rasterizer(backend, [still(cloud)], {"ada": avatar}, CAMERA, cache=tmp_path).render([VIEW]).rgb
        for backend in ("cpu", "reference")
    ]
    assert images[0].any()
    assert np.abs(images[0].astype(int) - images[1]).max() <= 2


@pytest.mark.parametrize(("detail", "folder"), [("exact", "packed-c0ffee-scene"), ("lod", "lod-c0ffee-scene")])
def test_packs_are_made_once(cloud: GaussianCloud, avatar: Avatar, tmp_path: Path, detail: str, folder: str) -> None:
    first = make_rasterizer("cpu", [still(cloud)], {"ada": avatar}, CAMERA, cache=tmp_path, detail=detail)
    assert folder in {path.name for path in tmp_path.iterdir()}

    def unwanted() -> GaussianCloud:
        raise AssertionError("the cloud was loaded again")

    clouds = [StaticCloud(key="c0ffee-scene", load=unwanted)]
    second = make_rasterizer("cpu", clouds, {"ada": avatar}, CAMERA, cache=tmp_path, detail=detail)
    assert np.array_equal(first.render([VIEW]).rgb, second.render([VIEW]).rgb)


def test_avatars_are_packed_in_their_own_folder(cloud: GaussianCloud, avatar: Avatar, tmp_path: Path) -> None:
    folders = {"cache": tmp_path / "scene", "avatar_cache": tmp_path / "people"}
    make_rasterizer("cpu", [still(cloud)], {"ada": avatar}, CAMERA, **folders)
    assert [path.name for path in folders["cache"].iterdir() if path.is_dir()] == ["packed-c0ffee-scene"]
    names = [path.name for path in folders["avatar_cache"].iterdir() if path.is_dir()]
    assert names == [f"avatar-{avatar_hash(avatar)[:16]}-exact"]


def test_avatars_that_another_process_packs_come_last_and_all_are_told_in_order(
    avatar: Avatar, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    avatars = {name: dataclasses.replace(avatar, name=name) for name in ("ada", "bo", "cy")}
    busy, asked = f"avatar-{avatar_hash(avatars['ada'])[:16]}-exact", []
    monkeypatch.setattr(backends, "is_being_made", lambda folder: folder.name == busy)
    monkeypatch.setattr(backends, "load_or_pack_avatar", lambda folder, one: asked.append(one.name) or one.name)
    assert list(packed_avatars(avatars, tmp_path).items()) == [("ada", "ada"), ("bo", "bo"), ("cy", "cy")]
    assert asked == ["bo", "cy", "ada"]


@pytest.mark.parametrize(("backend", "detail"), [("vulkan", "exact"), ("reference", "lod"), ("triton", "lod")])
def test_what_no_backend_draws_is_refused(cloud: GaussianCloud, tmp_path: Path, backend: str, detail: str) -> None:
    with pytest.raises(
        ValueError, match=r"must be one of cpu, reference, triton, gsplat|drawn by the backend cpu only"
    ):
        make_rasterizer(backend, [still(cloud)], {}, CAMERA, cache=tmp_path, detail=detail)


@pytest.mark.parametrize("backend", ["triton", "gsplat"])
def test_machine_without_a_gpu_is_told_so(cloud: GaussianCloud, tmp_path: Path, backend: str) -> None:
    if importlib.util.find_spec("torch") and importlib.import_module("torch").cuda.is_available():
        pytest.skip("this machine has a GPU")
    with pytest.raises(ReadygoError, match=r"\[gpu\]|CUDA device"):
        make_rasterizer(backend, [still(cloud)], {}, CAMERA, cache=tmp_path)
