import pytest

from readygo.benchmarks.rasterizer.setting import Measurement, Setting, open_setting

JOB = Measurement(
    scene="",
    synthetic="3k",
    avatars=2,
    placement="free",
    avatar_folder=None,
    avatar_gaussians=1000,
    motion=None,
    height_px=48,
    width_px=64,
    frames=16,
    views=2,
    threads=1,
    backend="cpu",
    lod="off",
    seed=0,
)


@pytest.fixture(autouse=True)
def own_cache(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))


@pytest.fixture
def setting() -> Setting:
    return open_setting(JOB)
