"""`readygo demo --reconstruct`: a room of the embedded flat is filmed, and made a scene again of the film."""

from collections.abc import Callable
from pathlib import Path

from rich.console import Console
from rich.table import Table

from readygo.apps.capture.compare import PoseErrors, pose_errors
from readygo.apps.capture.truth import read_truth, truth_path
from readygo.apps.commands.capture import scene_capture
from readygo.apps.commands.reconstruct import reconstruct_command
from readygo.common.scenes import load_scene

VIDEO, ROOM, WORK = "walk.mp4", "room", "room.work"
LIVING_ROOM_M, RADIUS_M = (-3.0, 3.0), 2.5
MARKER_SIZE_M = 0.2
STEPS = 1000
"""Of the training: a room can be recognized, not more."""


def reconstruct_room(out: Path, scene: str, say: Callable[[str], None]) -> Path:
    """Film the living room, and do what `readygo reconstruct` does with a user's video.

    Args:
        out: Folder for the film, the scene and what is in between.
        scene: Whose living room it is.
        say: Hears what is being done.

    Returns:
        The health report.

    Raises:
        ReadygoError: If the room cannot be reconstructed.
    """
    video, room = out / VIDEO, out / ROOM
    say(f"filming the living room with a marker of {MARKER_SIZE_M:g} m on its floor")
    scene_capture(scene, out=video, walk=True, marker_size_m=MARKER_SIZE_M, start=LIVING_ROOM_M, radius=RADIUS_M)
    say(f"readygo reconstruct {video} --marker-size-m {MARKER_SIZE_M:g} --steps {STEPS} --plain --out {room}")
    reconstruct_command(
        video, out=room, work=out / WORK, marker_size_m=MARKER_SIZE_M, steps=STEPS, plain=True, license="CC0-1.0"
    )
    views = load_scene(room).views
    assert views is not None
    errors = pose_errors(read_truth(truth_path(video)), dict(zip(views.images, views.T_world_camera, strict=True)))
    _print_errors(errors)
    return room / "inspect" / "report.html"


def _print_errors(errors: PoseErrors) -> None:
    table = Table(title="beside the truth, which a film of your own does not have", show_header=False)
    table.add_row("cameras", f"{100 * errors.camera_rmse_m:.1f} cm off (rmse of {errors.images} images)")
    table.add_row("lengths", f"{errors.scale_percent:+.2f} %")
    table.add_row("up", f"{errors.up_deg:.2f} deg off")
    Console(stderr=True).print(table)
