"""The page of a demonstrated reconstruction: a room that was filmed, reconstructed and driven in."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from readygo.apps.capture.compare import FoundPoseErrors
from readygo.apps.report.page import Block, PageTable, arrange_blocks, drawing, fact_table, film, page
from readygo.common.arrays import UInt8Array
from readygo.common.dataset import Dataset
from readygo.common.documents import read_json
from readygo.common.errors import RunError
from readygo.common.images.encoded import read_pixels
from readygo.common.scenes import Scene
from readygo.common.scenes.scene import REPORT_FILE
from readygo.common.scenes.top_view import top_view
from readygo.services.reconstructor import GAUSSIANS

_SHOWN = 4
_PICTURE_PX = 720


@dataclass(frozen=True, kw_only=True, eq=False)
class Reconstructed:
    """A room that was filmed and reconstructed, and the data that was recorded there."""

    report: dict[str, Any]
    """Report of the reconstruction, as returned by `reconstruct`."""
    errors: FoundPoseErrors
    work: Path
    source: Scene
    found: Scene
    data: Path
    seconds: float


def reconstruction_page(made: Reconstructed, episode: Path) -> str:
    """The page as HTML text.

    Args:
        made: The filmed and reconstructed room.
        episode: Video of an episode that was recorded there.
    """
    return page(
        "A room that was filmed",
        "A walk with a telephone through the living room of the embedded flat, past one printed marker: cameras, "
        "scale, Gaussians and maps were made of its film alone, and a robot was driven there among pedestrians.",
        tiles=tiles(made),
        sections={
            "Filmed and reconstructed": _held_out(made),
            "From above": arrange_blocks(
                "pair",
                [
                    drawing(top_view(made.source).rgb, "The flat."),
                    drawing(top_view(made.found).rgb, "What the reconstruction has of it, in its own frame."),
                ],
            ),
            "An episode in the reconstruction": [film(episode, "As it is recorded for training.")],
            "In numbers": [_numbers(made)],
        },
        facts={"scene": made.found.content_hash},
    )


def tiles(made: Reconstructed) -> list[tuple[str, str]]:
    """The key figures at the top of the page: value and name."""
    training, errors = made.report["training"], made.errors
    reachable_m2 = float(read_json(made.found.path / REPORT_FILE)["robot"]["reachable_m2"])
    return [
        (f"{errors.scale_percent:+.2f} %", "error of lengths, against the truth"),
        (f"{100 * errors.camera_rmse_m:.1f} cm", "error of cameras (rmse)"),
        (f"{training['psnr_db']:.1f} dB", "PSNR of images it has not seen"),
        (f"{reachable_m2:.1f} m2", "for the robot to move in"),
        (f"{made.seconds / 60:.0f} min", "in all"),
    ]


def photo_and_image(path: Path) -> UInt8Array:
    """The first two of a held-out preview's three pictures, enlarged.

    Raises:
        RunError: If the preview cannot be read.
    """
    bgr = read_pixels(path, cv2.IMREAD_COLOR)
    if bgr is None:
        raise RunError(f"{path} cannot be read.")
    both = cv2.cvtColor(bgr[:, : bgr.shape[1] // 3 * 2], cv2.COLOR_BGR2RGB)
    factor = max(1, _PICTURE_PX // both.shape[1] + 1)
    return np.asarray(cv2.resize(both, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC), dtype=np.uint8)


def _held_out(made: Reconstructed) -> list[Block]:
    folder = made.work / GAUSSIANS / "previews" / "held_out"
    rows = sorted(made.report["training"]["held_out"], key=lambda row: str(row["image"]))
    return [
        drawing(
            photo_and_image(folder / f"{Path(row['image']).stem}.png"),
            "Left the film, right the reconstruction from the same place, of which it had no image: "
            f"{row['psnr_db']:.1f} dB.",
            alt="film and reconstruction",
        )
        for row in rows[:: max(1, len(rows) // _SHOWN)][:_SHOWN]
    ]


def _numbers(made: Reconstructed) -> PageTable:
    report, errors, episodes = made.report, made.errors, Dataset(made.data).episodes
    interval = report["scale"]["interval_percent"]
    rows = [
        ("images with a pose", f"{report['verdict']['registered']} of {report['verdict']['images']}"),
        ("error of lengths", f"{errors.scale_percent:+.2f} %; its interval says +-{interval:.2f} % (95 %)"),
        ("error of cameras", f"{100 * errors.camera_rmse_m:.1f} cm rmse, {100 * errors.camera_max_m:.1f} cm at most"),
        ("error of up", f"{errors.up_deg:.2f} deg"),
        ("Gaussians", f"{report['training']['gaussians']:,}"),
        ("held-out images", f"{report['training']['psnr_db']:.2f} dB, SSIM {report['training']['ssim']:.3f}"),
        ("recorded", f"{len(episodes)} episodes, {sum(entry.sample_count for entry in episodes):,} samples"),
        *((f"time of {stage}", f"{seconds:.0f} s") for stage, seconds in report["seconds"].items()),
    ]
    return fact_table(rows)
