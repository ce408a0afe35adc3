"""One door: what comes with a file is checked, and the avatar can be saved."""

from pathlib import Path

import pytest

from readygo.common.avatars import load_avatar, save_avatar
from readygo.common.avatars.importers import ImportOptions, import_human
from readygo.common.errors import AvatarError, SceneError


def test_result_can_be_saved_and_loaded(bound: tuple[Path, Path], tmp_path: Path) -> None:
    avatar, _ = import_human(bound[0], ImportOptions(license="CC0-1.0", name="ann", weights=bound[1]))
    save_avatar(avatar, tmp_path / "ann.npz")
    loaded = load_avatar(tmp_path / "ann.npz")
    assert (loaded.name, loaded.license) == ("ann", "CC0-1.0")


def test_gaussians_without_weights_and_plain_point_clouds_are_refused(bound: tuple[Path, Path], tmp_path: Path) -> None:
    with pytest.raises(AvatarError, match="--weights"):
        import_human(bound[0], ImportOptions(license="test"))
    (tmp_path / "x.ply").write_bytes(b"ply\nformat ascii 1.0\nend_header\n")
    with pytest.raises(SceneError):
        import_human(tmp_path / "x.ply", ImportOptions(license="test", weights=bound[1]))


def test_options_are_checked() -> None:
    with pytest.raises(AvatarError, match="--license"):
        ImportOptions(license=" ")
    with pytest.raises(AvatarError, match="--gaussians"):
        ImportOptions(license="x", gaussians=3)
    with pytest.raises(AvatarError, match="--height-m"):
        ImportOptions(license="x", height_m=float("nan"))


def test_importers_load_no_heavy_libraries() -> None:
    import subprocess
    import sys

    code = "import sys, readygo.common.avatars.importers; print({'torch', 'cv2', 'zenoh'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
