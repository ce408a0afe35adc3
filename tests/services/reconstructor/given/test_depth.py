from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.services.reconstructor.frames.depths import read_steps
from readygo.services.reconstructor.given import depth
from readygo.services.reconstructor.given.depth import (
    DepthFile,
    absent_modules,
    find_depth,
    read_depth,
    write_depths,
)

SIZE_PX = (80, 60)


def png(path: Path, values: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), values)
    return path


def slope_mm(rows: int = 6, columns: int = 8) -> np.ndarray:
    return np.arange(1000, 1000 + rows * columns).reshape(rows, columns).astype(np.uint16)


def test_png_is_in_millimetres(tmp_path: Path) -> None:
    found = read_depth(DepthFile(path=png(tmp_path / "a.png", slope_mm())), SIZE_PX)
    np.testing.assert_allclose(found, slope_mm() / 1000.0, rtol=1e-6)


def test_low_confidence_zeros_and_what_is_out_of_reach_are_unmeasured(tmp_path: Path) -> None:
    values, confidence = np.full((6, 8), 2000, np.uint16), np.full((6, 8), 127, np.uint8)
    values[0, 0], values[1, 1], confidence[2, 2] = 0, 5001, 0
    png(tmp_path / "a.png", values)
    png(tmp_path / "c.png", confidence)
    file = find_depth(tmp_path / "a.png", tmp_path / "c.png", far_m=5.0)
    assert file is not None
    assert file.files == [tmp_path / "a.png", tmp_path / "c.png"]
    found = read_depth(file, SIZE_PX)
    assert found is not None
    assert [tuple(place) for place in np.argwhere(found == 0)] == [(0, 0), (1, 1), (2, 2)]
    assert (found[found > 0] == np.float32(2.0)).all()


def test_without_confidence_all_depths_count(tmp_path: Path) -> None:
    file = find_depth(png(tmp_path / "a.png", slope_mm()), tmp_path / "missing.png")
    assert file is not None
    assert file.confidence is None
    assert (read_depth(file, SIZE_PX) > 0).all()
    assert find_depth(tmp_path / "missing.png") is None


def test_fine_depth_images_are_thinned_without_means(tmp_path: Path) -> None:
    values = np.where(np.indices((600, 800)).sum(axis=0) % 2, 1000, 4000).astype(np.uint16)
    found = read_depth(DepthFile(path=png(tmp_path / "a.png", values)), SIZE_PX)
    assert found is not None
    assert found.shape == (192, 256)
    assert set(np.unique(found)) <= {np.float32(1.0), np.float32(4.0)}
    ramp = np.tile(np.arange(1, 801, dtype=np.uint16) * 10, (600, 1))
    thinned = read_depth(DepthFile(path=png(tmp_path / "b.png", ramp)), SIZE_PX)
    assert thinned is not None
    np.testing.assert_allclose(thinned[0] * 100, (np.arange(256) + 0.5) * 800 / 256 + 0.5, atol=0.51)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (np.full((8, 6), 900, np.uint16), r"a\.png is 6x8 px, its image 80x60 px"),
        (np.full((6, 8), 90, np.uint8), "8 bits and 1 channels: depth images have one channel of 16 bits"),
        (np.full((6, 8, 3), 900, np.uint16), "16 bits and 3 channels"),
        (np.full((6, 8), 3, np.uint16), r"median depth of 0\.003 m: these look like metres instead of millimetres"),
    ],
)
def test_impossible_depths_are_refused_in_one_line(tmp_path: Path, values: np.ndarray, words: str) -> None:
    with pytest.raises(SceneError, match=words) as error:
        read_depth(DepthFile(path=png(tmp_path / "a.png", values)), SIZE_PX)
    assert "\n" not in str(error.value)
    assert "--frames.depth false" in str(error.value)


def test_broken_and_empty_ones_are_none(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"no image")
    assert read_depth(DepthFile(path=tmp_path / "a.png"), SIZE_PX) is None
    assert read_depth(DepthFile(path=png(tmp_path / "b.png", 0 * slope_mm())), SIZE_PX) is None


@pytest.mark.parametrize("confidence", [np.ones((3, 4), np.uint8), None])
def test_confidence_of_another_size_is_refused(tmp_path: Path, confidence: np.ndarray | None) -> None:
    path = tmp_path / "c.png"
    if confidence is None:
        path.write_bytes(b"no image")
    else:
        png(path, confidence)
    with pytest.raises(SceneError, match=r"c\.png is no image of 8x6 confidences"):
        read_depth(DepthFile(path=png(tmp_path / "a.png", slope_mm()), confidence=path), SIZE_PX)


def test_lzfse_is_in_metres_and_has_the_shape_of_its_image(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(depth, "_decompress", Path.read_bytes)
    portrait = (slope_mm(8, 6) / 1000.0).astype(np.float32)
    portrait[0, 0] = np.nan
    confidence = np.full((8, 6), 2, np.uint8)
    confidence[7, 5] = 0
    (tmp_path / "0.depth").write_bytes(portrait.tobytes())
    (tmp_path / "0.conf").write_bytes(confidence.tobytes())
    file = find_depth(tmp_path / "0.depth", tmp_path / "0.conf")
    assert file is not None
    found = read_depth(file, SIZE_PX[::-1])
    assert found is not None
    assert (found[0, 0], found[7, 5]) == (0.0, 0.0)
    portrait[0, 0] = portrait[7, 5] = 0.0
    np.testing.assert_array_equal(found, portrait)
    (tmp_path / "0.depth").write_bytes(portrait.tobytes()[:-4])
    with pytest.raises(SceneError, match=r"has 47 depths, which make no image as 60x80 px do"):
        read_depth(file, SIZE_PX[::-1])
    (tmp_path / "0.depth").write_bytes((1000 * portrait).tobytes())
    with pytest.raises(SceneError, match="median depth of 1024 m: these look like millimetres instead of metres"):
        read_depth(file, SIZE_PX[::-1])


def test_lzfse_of_a_device_is_read(tmp_path: Path) -> None:
    liblzfse = pytest.importorskip("liblzfse", reason="pyliblzfse (extra record3d) is not installed")
    values = (slope_mm(60, 80) / 1000.0).astype(np.float32)
    (tmp_path / "0.depth").write_bytes(liblzfse.compress(values.tobytes()))
    np.testing.assert_array_equal(read_depth(DepthFile(path=tmp_path / "0.depth"), SIZE_PX), values)
    (tmp_path / "0.depth").write_bytes(b"no LZFSE")
    assert read_depth(DepthFile(path=tmp_path / "0.depth"), SIZE_PX) is None


def test_exr_is_in_metres(tmp_path: Path) -> None:
    OpenEXR = pytest.importorskip("OpenEXR", reason="OpenEXR (extra record3d) is not installed")
    values = (slope_mm() / 1000.0).astype(np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"R": values}) as file:
        file.write(str(tmp_path / "0.exr"))
    np.testing.assert_array_equal(read_depth(DepthFile(path=tmp_path / "0.exr"), SIZE_PX), values)
    (tmp_path / "0.exr").write_bytes(b"no EXR")
    assert read_depth(DepthFile(path=tmp_path / "0.exr"), SIZE_PX) is None


def test_depths_are_written_by_the_names_of_their_images_and_lost_ones_are_told(tmp_path: Path) -> None:
    (tmp_path / "broken.png").write_bytes(b"no image")
    depths = {
        "left/0.jpg": DepthFile(path=png(tmp_path / "a.png", slope_mm())),
        "1.jpg": None,
        "2.jpg": DepthFile(path=tmp_path / "broken.png"),
    }
    count, notes = write_depths(depths, dict.fromkeys(depths, SIZE_PX), tmp_path / "out")
    assert (count, notes) == (1, ["depth images of 2 of 3 images are missing, broken or empty"])
    np.testing.assert_array_equal(read_steps(tmp_path / "out" / "left" / "0.jpg.png"), slope_mm())
    assert len(list((tmp_path / "out").rglob("*.png"))) == 1


def test_images_without_any_depth_have_no_note(tmp_path: Path) -> None:
    assert write_depths({"1.jpg": None}, {"1.jpg": SIZE_PX}, tmp_path / "out") == (0, [])
    assert not (tmp_path / "out").exists()


def test_missing_module_is_one_note_with_what_installs_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(depth, "is_installed", lambda module: False)
    depths = {f"{row}.jpg": DepthFile(path=tmp_path / f"{row}.depth") for row in range(3)}
    count, notes = write_depths(depths, dict.fromkeys(depths, SIZE_PX), tmp_path / "out")
    assert count == 0
    assert len(notes) == 1
    assert "needs liblzfse; run: " in notes[0]
    assert absent_modules([*depths.values(), None, DepthFile(path=tmp_path / "0.EXR")]) == ["OpenEXR", "liblzfse"]
    assert absent_modules([DepthFile(path=tmp_path / "0.png")]) == []
