"""A small scene with cameras and the report of a reconstruction."""

from pathlib import Path
from typing import Any

from readygo.common.scenes import Scene, save_scene
from tests.common.scenes.small_room import cameras, small_room

MADE: dict[str, Any] = {
    "scale": {"metres_per_unit": 0.5, "source": "marker 0 of 0.2 m", "interval_percent": 0.22},
    "verdict": {"images": 40, "registered": 38, "registered_share": 0.95, "reprojection_px": 0.5, "components": [38]},
    "notes": ["check: the floor <leans>"],
    "training": {
        "psnr_db": 25.5,
        "ssim": 0.85,
        "held_out": [
            {"image": "0.jpg", "psnr_db": 19.0, "ssim": 0.7},
            {"image": "9.jpg", "psnr_db": 27.0, "ssim": 0.9},
            {"image": "gone.jpg", "psnr_db": 27.0, "ssim": 0.9},
        ],
    },
}


def reconstructed(folder: Path) -> Scene:
    """The room with its cameras."""
    return save_scene(small_room(), None, folder, views=cameras(), reconstruction=MADE)
