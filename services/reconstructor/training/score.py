"""How well Gaussians show the photos that they were not trained on."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from readygo.common.arrays import Float32Array
from readygo.common.drawing.files import quantise, write_png
from readygo.services.reconstructor.training.drawing import draw, leaves_of, planes_of
from readygo.services.reconstructor.training.parameters import Gaussians
from readygo.services.reconstructor.training.photometric import Photometric, fit_colours, psnr_db
from readygo.services.reconstructor.training.photos import PhotoStore

PREVIEWS = "previews"
"""Folder of a training's pictures."""


@dataclass(frozen=True, kw_only=True, eq=False)
class HeldOut:
    """A held-out photo, and what the Gaussians show in its place."""

    image: str
    psnr_db: float
    """PSNR of the colours as they are [dB]."""
    psnr_fitted_db: float
    """PSNR after the affine map of the colours that fits the photo best: exposure and white balance taken out [dB]."""
    ssim: float
    photo: Float32Array
    """The photo, shape (3, H, W)."""
    rendered: Float32Array
    """The rendered view, shape (3, H, W)."""


def measure(gaussians: Gaussians, photos: PhotoStore | None, sh_degree: int) -> list[HeldOut]:
    """Draw the held-out photos' views without exposure, which is unknown for them; masked pixels do not count."""
    leaves = leaves_of(gaussians)
    scores = []
    for name, photo in photos.items() if photos else ():
        rendered = np.clip(planes_of(draw(leaves, photo, sh_degree)), 0.0, 1.0)
        counts = np.ones(rendered.shape[1:], np.bool_) if photo.mask is None else photo.mask
        share = float(counts.mean())
        if not share:
            continue
        # What is ignored agrees with what is drawn, and is taken out of the mean.
        wanted = np.where(counts, photo.rgb, rendered)
        _, ssim, _ = Photometric(*rendered.shape[1:])(rendered, wanted, 1.0)
        shown, true = rendered[:, counts], photo.rgb[:, counts]
        scores.append(
            HeldOut(
                image=name,
                psnr_db=psnr_db(shown, true),
                psnr_fitted_db=psnr_db(fit_colours(shown, true), true),
                ssim=1.0 - (1.0 - ssim) / share,
                photo=photo.rgb,
                rendered=rendered,
            )
        )
    return scores


def picture_name(image: str) -> str:
    """File of the picture of an image, whose name may have folders."""
    return f"{image.rpartition('.')[0].replace('/', '_')}.png"


def write_picture(path: Path, score: HeldOut) -> None:
    """The photo, what is shown in its place, and four times their difference, side by side."""
    difference = 4.0 * np.abs(score.photo - score.rendered)
    write_png(path, quantise(np.concatenate([score.photo, score.rendered, difference], axis=2)))
