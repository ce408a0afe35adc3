import json
import struct
import tracemalloc
from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.services.reconstructor.config import ReconstructorConfig
from readygo.services.reconstructor.frames.config import FramesConfig
from readygo.services.reconstructor.frames.video import cut_off, extract_frames, is_same_shape, shrunk
from readygo.services.reconstructor.handlers import known_lens
from readygo.services.reconstructor.poses.config import PosesConfig

FOOTAGE = Path(__file__).parent / "footage"


@pytest.mark.parametrize(
    ("one_px", "other_px", "same"),
    [
        ((640, 480), (320, 240), True),
        ((641, 480), (320, 240), True),
        ((640, 480), (480, 640), False),
        ((640, 480), (640, 360), False),
    ],
)
def test_shape_is_that_of_an_image_made_smaller_but_for_rounding(
    one_px: tuple[int, int], other_px: tuple[int, int], same: bool
) -> None:
    assert is_same_shape(one_px, other_px) is same
    assert is_same_shape(other_px, one_px) is same


def film(path: Path, *, frames: int, step_px: int) -> None:
    """A wide picture that passes by, 160 x 120 pixels, ten frames a second."""
    noise = np.random.default_rng(0).integers(0, 255, (30, 200, 3), dtype=np.uint8)
    wide = cv2.resize(noise, (800, 120), interpolation=cv2.INTER_CUBIC)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 10.0, (160, 120))
    for number in range(frames):
        writer.write(np.ascontiguousarray(wide[:, step_px * number : step_px * number + 160]))
    writer.release()


def test_frames_of_a_moving_video_are_kept_and_made_smaller(tmp_path: Path) -> None:
    film(tmp_path / "v.mp4", frames=40, step_px=8)
    found = extract_frames(tmp_path / "v.mp4", tmp_path, FramesConfig(count_max=15))
    names = sorted(path.name for path in tmp_path.glob("*.jpg"))
    assert found["kept"] == len(names)
    assert 10 <= len(names) <= 15
    assert found["size_px"] == [160, 120]


def test_movement_of_360_degree_images_is_measured_by_the_width_of_a_view(tmp_path: Path) -> None:
    film(tmp_path / "v.mp4", frames=40, step_px=1)
    with pytest.raises(SceneError, match="the picture moves by"):
        extract_frames(tmp_path / "v.mp4", tmp_path / "out", FramesConfig())
    found = extract_frames(tmp_path / "v.mp4", tmp_path / "out", FramesConfig(projection="equirectangular"))
    assert found["kept"] >= 10


def held_upright(path: Path) -> None:
    """Let a video say that it is to be turned clockwise by a quarter, as phones write it."""
    data = bytearray(path.read_bytes())
    at = data.index(b"tkhd") + 4 + 40
    data[at : at + 36] = struct.pack(">9i", 0, 1 << 16, 0, -(1 << 16), 0, 0, 120 << 16, 0, 1 << 30)
    path.write_bytes(bytes(data))


def test_video_that_was_held_upright_is_turned(tmp_path: Path) -> None:
    film(tmp_path / "v.mp4", frames=40, step_px=8)
    assert extract_frames(tmp_path / "v.mp4", tmp_path / "flat", FramesConfig())["turned_deg"] == 0
    held_upright(tmp_path / "v.mp4")
    found = extract_frames(tmp_path / "v.mp4", tmp_path / "upright", FramesConfig())
    assert (found["size_px"], found["source_px"], found["turned_deg"]) == ([120, 160], [120, 160], 90)
    # The first frame is in both.
    flat, upright = (cv2.imread(str(tmp_path / name / "000000.jpg")) for name in ("flat", "upright"))
    assert np.abs(cv2.rotate(flat, cv2.ROTATE_90_CLOCKWISE).astype(int) - upright).mean() < 4


def test_lens_of_the_sensor_is_turned_as_the_video_is(tmp_path: Path) -> None:
    film(tmp_path / "v.mp4", frames=40, step_px=8)
    held_upright(tmp_path / "v.mp4")
    found = extract_frames(tmp_path / "v.mp4", tmp_path / "f", FramesConfig())
    lens = tmp_path / "lens.json"
    lens.write_text(json.dumps({"fx": 100, "fy": 101, "cx": 82, "cy": 57, "width": 160, "height": 120}))
    fitted = known_lens(found, ReconstructorConfig(poses=PosesConfig(intrinsics=str(lens))))
    assert fitted is not None
    assert fitted.params[:4] == (101.0, 100.0, 63.0, 82.0)


def test_hevc_is_read(tmp_path: Path) -> None:
    """A video of 96x64 px, 24 frames at 10 Hz, made by libx265."""
    found = extract_frames(FOOTAGE / "hevc.mp4", tmp_path, FramesConfig())
    assert (found["frames"], found["seconds"], found["size_px"]) == (24, 2.4, [96, 64])
    assert found["kept"] >= 10


def test_video_of_a_variable_rate_lasts_as_long_as_its_times_say(tmp_path: Path) -> None:
    """12 frames 0.1 s apart, then 12 that are 0.3 s apart; its mean rate would say 4.4 s."""
    found = extract_frames(FOOTAGE / "variable_rate.mp4", tmp_path, FramesConfig())
    assert found["frames"] == 24
    assert found["seconds"] == pytest.approx(4.7 * 24 / 23, abs=0.01)
    # The picture moves as far in each frame: frames are spread over its movement, not over time.
    numbers = [int(path.stem) for path in sorted(tmp_path.glob("*.jpg"))]
    assert len(numbers) >= 10
    assert max(np.diff(numbers)) <= 3


@pytest.mark.slow
def test_video_in_4k_is_made_smaller_frame_by_frame(tmp_path: Path) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (54, 120, 3), dtype=np.uint8)
    wide = cv2.resize(noise, (6720, 2160), interpolation=cv2.INTER_CUBIC)
    writer = cv2.VideoWriter(str(tmp_path / "v.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 5.0, (3840, 2160))
    for number in range(12):
        writer.write(np.ascontiguousarray(wide[:, 240 * number : 240 * number + 3840]))
    writer.release()
    tracemalloc.start()
    found = extract_frames(tmp_path / "v.mp4", tmp_path, FramesConfig(count_max=12))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert (found["size_px"], found["source_px"]) == ([1600, 900], [3840, 2160])
    frame_bytes = 3840 * 2160 * 3
    assert frame_bytes < peak < 6 * frame_bytes, "two frames, and one of them in light"


def test_images_made_smaller_keep_the_light() -> None:
    """Edges of black and white stay where they are: the light of a row is the same share."""
    row = np.zeros((8, 1000, 3), np.uint8)
    row[:, 333:] = 255
    small = shrunk(row, 170)
    assert small.shape == (1, 170, 3)
    assert ((small[0, :, 0] / 255.0) ** 2.2).mean() == pytest.approx(0.667, abs=0.0005)


@pytest.mark.parametrize(
    ("frames", "step_px", "words"), [(10, 8, "10 frames, 1.0 s"), (40, 0, "A camera that stands still shows no depth")]
)
def test_videos_of_no_use_are_refused(tmp_path: Path, frames: int, step_px: int, words: str) -> None:
    film(tmp_path / "v.mp4", frames=frames, step_px=step_px)
    with pytest.raises(SceneError, match=words):
        extract_frames(tmp_path / "v.mp4", tmp_path, FramesConfig())
    assert not list(tmp_path.glob("*.jpg"))


def test_file_that_is_no_video_is_refused(tmp_path: Path) -> None:
    (tmp_path / "v.mp4").write_bytes(b"not a video")
    with pytest.raises(SceneError, match="cannot be read as a video"):
        extract_frames(tmp_path / "v.mp4", tmp_path, FramesConfig())


def test_film_whose_end_is_missing_is_called_cut_off(tmp_path: Path) -> None:
    film(tmp_path / "whole.mp4", frames=40, step_px=8)
    assert cut_off(tmp_path / "whole.mp4") is None
    data = (tmp_path / "whole.mp4").read_bytes()
    (tmp_path / "v.mp4").write_bytes(data[: len(data) // 2])
    with pytest.raises(SceneError, match=r"v.mp4 is cut off: it has .* bytes of .*moov atom.* Copy it again") as error:
        extract_frames(tmp_path / "v.mp4", tmp_path, FramesConfig())
    assert "\n" not in str(error.value)
    assert "H.264" not in str(error.value)


def box(kind: bytes, length: int, *, wide: bool = False) -> bytes:
    """A box of zeros: its length, with 64 bits if it is wide, and its kind."""
    head = struct.pack(">I4sQ", 1, kind, length) if wide else struct.pack(">I4s", length, kind)
    return head + bytes(length - len(head))


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (box(b"ftyp", 24) + box(b"moov", 40) + box(b"mdat", 90), None),
        (box(b"ftyp", 24) + box(b"moov", 40) + box(b"mdat", 90)[:50], "has 114 bytes of 154 or more"),
        (box(b"ftyp", 24) + box(b"mdat", 90, wide=True), "the moov atom) is missing, which cameras write at the end"),
        (box(b"ftyp", 24) + box(b"mdat", 90, wide=True) + box(b"moov", 30), None),
        (box(b"ftyp", 24) + struct.pack(">I4s", 3, b"mdat"), "damaged"),
        (b"RIFF" + bytes(60), None),
        (b"", None),
    ],
    ids=["whole", "moov first", "no moov", "wide box", "damaged", "avi", "empty"],
)
def test_boxes_tell_whether_the_end_is_missing(tmp_path: Path, data: bytes, words: str | None) -> None:
    path = tmp_path / "v.mp4"
    path.write_bytes(data)
    said = cut_off(path)
    assert said is None if words is None else said is not None and words in said


def test_film_with_its_index_in_front_is_used_as_far_as_it_goes(tmp_path: Path) -> None:
    film(tmp_path / "v.mp4", frames=40, step_px=8)
    found = extract_frames(tmp_path / "v.mp4", tmp_path, FramesConfig())
    assert (found["source_px"], found["size_px"], found["notes"]) == ([160, 120], [160, 120], [])
    with (tmp_path / "v.mp4").open("ab") as file:
        file.write(struct.pack(">I4s", 900, b"free"))
    found = extract_frames(tmp_path / "v.mp4", tmp_path, FramesConfig())
    assert "is cut off" in found["notes"][0]
    assert "its first 4.0 s are used" in found["notes"][0]
