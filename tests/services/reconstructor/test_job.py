from pathlib import Path

import pytest

from readygo.common.errors import SceneError
from readygo.services.reconstructor.given import depth
from readygo.services.reconstructor.job import open_source
from readygo.services.reconstructor.stages import identity_of
from tests.services.reconstructor.given import test_find, test_record3d
from tests.services.reconstructor.synthetic import photos


def test_kinds_of_sources_are_told_apart(tmp_path: Path) -> None:
    (tmp_path / "v.mp4").write_bytes(b"x")
    assert open_source(tmp_path / "v.mp4").kind == "video"
    assert open_source(photos(tmp_path / "p", 2)).kind == "photos"
    assert open_source(test_find.transforms(tmp_path / "t")).kind == "capture"
    assert open_source(tmp_path / "t" / "transforms.json").kind == "capture"
    names = {name for name, _, _ in open_source(tmp_path / "t").identity}
    assert names == {"transforms.json", "0.png", "1.png", "2.png", "3.png"}
    (tmp_path / "m" / "sparse").mkdir(parents=True)
    for name in ("cameras", "images", "points3D"):
        (tmp_path / "m" / "sparse" / f"{name}.txt").touch()
    (tmp_path / "m" / "images").mkdir()
    assert open_source(tmp_path / "m").kind == "colmap"


def test_paths_that_are_no_source_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match="does not exist"):
        open_source(tmp_path / "x.mp4")
    with pytest.raises(SceneError, match="holds no photos"):
        open_source(tmp_path)


def colmap_source(folder: Path) -> Path:
    """A distorted model of the images 2.jpg, 10.jpg and sub/c.jpg, and files beside these."""
    (folder / "sparse").mkdir(parents=True)
    (folder / "sparse" / "cameras.txt").write_text("1 SIMPLE_RADIAL 80 60 75 40 30 0.01\n")
    names = ("10.jpg", "2.jpg", "sub/c.jpg")
    rows = [f"{row + 1} 1 0 0 0 {row} 0 0 1 {name}\n\n" for row, name in enumerate(names)]
    (folder / "sparse" / "images.txt").write_text("".join(rows))
    (folder / "sparse" / "points3D.txt").touch()
    for name in (*names, "unused.jpg", ".DS_Store"):
        (folder / "images" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "images" / name).write_bytes(name.encode())
    return folder


def test_identity_of_a_colmap_source_is_that_of_its_model_and_of_the_images_in_it(tmp_path: Path) -> None:
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    folder = colmap_source(tmp_path / "m")
    before = open_source(folder).identity
    assert [name for name, _, _ in before] == [
        "cameras.txt", "images.txt", "points3D.txt", "2.jpg", "10.jpg", "c.jpg"
    ]  # fmt: skip
    for name in ("images/unused.jpg", "sparse/project.ini"):
        (folder / name).write_bytes(b"other")
    assert open_source(folder).identity == before
    (folder / "images" / "2.jpg").write_bytes(b"another image")
    assert open_source(folder).identity != before


def test_missing_image_of_a_colmap_source_is_named_at_once(tmp_path: Path) -> None:
    pytest.importorskip("pycolmap", reason="pycolmap is not installed")
    folder = colmap_source(tmp_path / "m")
    (folder / "images" / "2.jpg").unlink()
    with pytest.raises(SceneError, match=r"lacks 1 images of its COLMAP model, .*/2\.jpg among them"):
        open_source(folder)


def test_identity_of_a_capture_holds_its_depths_and_what_cannot_be_read_yet(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    metadata, _ = test_record3d.export(tmp_path)
    before = open_source(tmp_path).identity
    (tmp_path / "depth").mkdir()
    (tmp_path / "depth" / "0.exr").write_bytes(b"depths")
    monkeypatch.setattr(depth, "is_installed", lambda module: False)
    without = open_source(tmp_path).identity
    assert without == (*before, *identity_of([tmp_path / "depth" / "0.exr"]), ("OpenEXR", 0, 0))
    monkeypatch.setattr(depth, "is_installed", lambda module: True)
    assert open_source(tmp_path).identity == without[:-1]
    assert metadata.name in {name for name, _, _ in before}
