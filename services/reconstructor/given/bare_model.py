"""A COLMAP model with poses but without tracks, as `readygo scene export` writes: no image tells what it sees."""

from pathlib import Path

from readygo.common.errors import SceneError
from readygo.services.reconstructor.given.capture import GivenCapture
from readygo.services.reconstructor.poses import colmap
from readygo.services.reconstructor.poses.intrinsics import Intrinsics


def find_bare_model(path: Path) -> Path | None:
    """The model of a folder if its cameras are pinholes and no image sees a point; None for another or none."""
    model = colmap.find_model(path)
    try:
        bare = model is not None and colmap.is_pinhole(model) and not colmap.has_tracks(model)
    except SceneError:
        return None
    return model if bare else None


def read_bare_model(path: Path, model: Path) -> GivenCapture:
    """Read poses and lenses; the scale is not known.

    Args:
        path: Folder with images/.
        model: The model's folder.
    """
    views = colmap.pinhole_views(model)
    lenses = [
        Intrinsics(model="PINHOLE", params=(K[0, 0], K[1, 1], K[0, 2], K[1, 2]), size_px=(int(size[0]), int(size[1])))
        for K, size in zip(views.K_px, views.sizes_px, strict=True)
    ]
    return GivenCapture(
        kind="COLMAP model without tracks",
        files=tuple(sorted(model.iterdir())),
        images=tuple(path / "images" / name for name in views.images),
        lenses=tuple(lenses),
        T_world_camera=views.T_world_camera,
        metric=False,
        rough=False,
    )
