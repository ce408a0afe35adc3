"""Frames of videos."""

import os
import struct
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from readygo.common.arrays import UInt8Array
from readygo.common.errors import SceneError
from readygo.common.files import open_regular
from readygo.services.reconstructor.frames.config import FramesConfig
from readygo.services.reconstructor.frames.light import encode_light, light_of
from readygo.services.reconstructor.frames.select import FrameScores, choose_frames, motion, sharpness, small_grey

FRAMES_MIN = 10
_STEP = 0.05
"""Movement of the picture from one used image to the next, as share of its width."""
_PANORAMA_SHARE = 0.25
"""Share of a 360-degree image's width that a view of 90 deg has: movements are measured by views."""
_WAY_MIN = 0.3
"""A picture that moved less in all, as share of its width, was not filmed walking."""
JPEG_QUALITY = 97
_BOX_HEADER, _BOXES_MAX = 8, 100_000
_FIRST_BOXES = (b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide")
"""Kinds of the first box of .mp4 and .mov."""

# FFmpeg writes what it thinks of a broken file to stderr itself, beside our line.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")


def extract_frames(video: Path, folder: Path, config: FramesConfig) -> dict[str, Any]:
    """Write the frames of a video that are used as `folder`/000123.jpg, by their number.

    Returns:
        What was found: frames, seconds, kept, size of the images and of the video's own upright frames, by how much
        these were turned clockwise [deg], notes.

    Raises:
        SceneError: If the video cannot be read, is too short, or does not move.
    """
    scores, seconds = _scores(video)
    if config.projection == "equirectangular":
        scores = replace(scores, motion=scores.motion / _PANORAMA_SHARE)
    count, cut = len(scores.sharpness), cut_off(video)
    way = float(scores.motion.sum())
    chosen = choose_frames(scores, count_max=config.count_max, step=_STEP) if count else np.array([], np.int64)
    if cut and (count < FRAMES_MIN or seconds < 2.0):
        raise SceneError(f"{cut}; {count} frames of it can be read.")
    if count < FRAMES_MIN or seconds < 2.0:
        raise SceneError(f"{video.name} has {count} frames, {seconds:.1f} s: film the place for half a minute or more.")
    if way < _WAY_MIN:
        raise SceneError(
            f"{video.name}: the picture moves by {100 * way:.0f} % of its width in {seconds:.0f} s. A camera that "
            "stands still shows no depth: walk through the place while you film."
        )
    if len(chosen) < FRAMES_MIN:
        raise SceneError(
            f"{video.name} gives {len(chosen)} sharp frames from places apart, {FRAMES_MIN} are needed: "
            "film longer, walk slowly, with more light."
        )
    wanted = set(chosen.tolist())
    size = source = (0, 0)
    for number, (bgr, _) in enumerate(read_frames(video)):
        if number in wanted:
            source = (bgr.shape[1], bgr.shape[0])
            bgr = shrunk(bgr, config.side_max_px)
            size = (bgr.shape[1], bgr.shape[0])
            write_jpeg(folder / f"{number:06d}.jpg", bgr)
        if number >= chosen[-1]:
            break
    notes = [f"{cut}; its first {seconds:.1f} s are used"] if cut else []
    return {"frames": count, "seconds": round(seconds, 2), "kept": len(chosen), "size_px": list(size),
            "source_px": list(source), "turned_deg": turned_deg(video), "notes": notes}  # fmt: skip


def shrunk(bgr: UInt8Array, side_max_px: int) -> UInt8Array:
    """An image (H, W, 3) whose longer side has at most so many pixels; pixels become means of light."""
    share = side_max_px / max(bgr.shape[:2])
    if share >= 1.0:
        return bgr
    size = (round(bgr.shape[1] * share), round(bgr.shape[0] * share))
    return encode_light(np.asarray(cv2.resize(light_of(bgr), size, interpolation=cv2.INTER_AREA), dtype=np.uint16))


def is_same_shape(one_px: tuple[int, int], other_px: tuple[int, int]) -> bool:
    """True if images of two sizes (width, height) are one image made larger or smaller, but for rounding to pixels."""
    return abs(one_px[0] * other_px[1] - one_px[1] * other_px[0]) <= max(*one_px, *other_px)


def write_jpeg(path: Path, bgr: UInt8Array) -> None:
    """Write an image (H, W, 3).

    Raises:
        OSError: If it cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    done, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    assert done
    path.write_bytes(data.tobytes())


def _scores(video: Path) -> tuple[FrameScores, float]:
    """Scores of all frames, and the seconds that they last."""
    sharp, moved, before, times_s = [], [], None, []
    for bgr, time_s in read_frames(video):
        now = small_grey(bgr)
        times_s.append(time_s)
        sharp.append(sharpness(bgr))
        moved.append(0.0 if before is None else motion(before, now))
        before = now
    return FrameScores(sharpness=np.array(sharp), motion=np.array(moved)), _seconds(video, times_s)


def _seconds(video: Path, times_s: Sequence[float]) -> float:
    """How long frames last that begin at these times; where a file tells none, by its rate."""
    count = len(times_s)
    if count > 1 and times_s[-1] > times_s[0]:
        return (times_s[-1] - times_s[0]) * count / (count - 1)
    return count / (open_video(video).get(cv2.CAP_PROP_FPS) or 30.0)


def turned_deg(video: Path) -> int:
    """By how much frames are turned clockwise to be upright, as the video says that it was held [deg]."""
    return round(float(open_video(video).get(cv2.CAP_PROP_ORIENTATION_META))) % 360


def read_frames(video: Path) -> Iterator[tuple[UInt8Array, float]]:
    """All frames, turned as the video says that it was held, and when they begin [s].

    Raises:
        SceneError: If it cannot be read.
    """
    capture = open_video(video)
    try:
        while True:
            there, bgr = capture.read()
            if not there:
                return
            yield bgr, capture.get(cv2.CAP_PROP_POS_MSEC) / 1000.0
    finally:
        capture.release()


def open_video(video: Path) -> Any:
    """OpenCV's reader of a video, which turns frames as the video says that it was held.

    Raises:
        SceneError: If it cannot be read.
    """
    capture = cv2.VideoCapture(str(video))
    if not capture.isOpened():
        cut = cut_off(video)
        if cut:
            raise SceneError(f"{cut}. Copy it again from where it was filmed; if it is no longer there, film again.")
        raise SceneError(f"{video} cannot be read as a video; convert it, for example to H.264 in .mp4.")
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 1)
    return capture


def cut_off(video: Path) -> str | None:
    """How an .mp4 or .mov shows that its end is missing, in words; None if it does not, or is of another kind.

    Such a file is a sequence of boxes, each with its length in front; `moov` is the index, often at the end.

    Source: ISO/IEC 14496-12, section 4.2.
    """
    there = video.stat().st_size
    kinds: list[bytes] = []
    with open_regular(video) as stream:
        at = 0
        while at + _BOX_HEADER <= there and len(kinds) < _BOXES_MAX:
            stream.seek(at)
            length, kind = struct.unpack(">I4s", stream.read(_BOX_HEADER))
            if not kinds and kind not in _FIRST_BOXES:
                return None
            kinds.append(kind)
            if length == 1:  # the length follows, with 64 bits
                length = int.from_bytes(stream.read(8), "big")
            if length == 0:  # to the end of the file
                break
            if length < _BOX_HEADER:
                return f"{video} is damaged: a part of it has no valid length"
            at += length
    if kinds and at > there:
        missing = "" if b"moov" in kinds else " and its index (the moov atom) is missing"
        return f"{video} is cut off: it has {there:,} bytes of {at:,} or more{missing}"
    if kinds and b"moov" not in kinds:
        return f"{video} is cut off: its index (the moov atom) is missing, which cameras write at the end"
    return None
