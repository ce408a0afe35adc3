"""The scene behind a person who is filmed: what each frame would show without the person.

A plate is an image of the scene's Gaussians from the frame's camera, in the colours of the photo: with the gain and the
offset of each channel that fit best where no person is. With plates a fit compares whole photos, and masks need not be
exact: a pixel that the person leaves free must look as the scene does.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array, UInt8Array
from readygo.common.errors import AvatarError
from readygo.common.gaussians import GaussianCloud
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import View
from readygo.common.rasterizer.packed.scene import PackedScene, pack_cloud
from readygo.services.reconstructor.avatars.views import FilmedPerson, band_px, widened

PLATE_SHARE_MIN, PLATE_PSNR_DB = 0.5, 30.0
"""Plates that explain less of the variance of the photos' colours, where no person is, and differ more from them, are
of another place or frame of reference."""
_BESIDE_MIN = 50


def with_plates(person: FilmedPerson, clouds: Sequence[GaussianCloud]) -> FilmedPerson:
    """The film with its plates, and a note of how much these look like the photos where no person is.

    Args:
        person: The film.
        clouds: Gaussians of the scene, in the world of the film's cameras.

    Raises:
        AvatarError: If the plates do not look like the photos.
    """
    packed = [pack_cloud(cloud) for cloud in clouds]
    plates, colours, squares, spread, pixels = [], [], 0.0, 0.0, 0
    for number, rgb in enumerate(person.rgb):
        beside = ~widened(person.mask[number], band_px(person.mask[number]))
        drawn = _drawn(person, number, packed)
        gain, offset = _photo_colours(drawn, rgb, beside)
        plate = np.clip(np.rint(gain * drawn + 255.0 * offset), 0, 255).astype(np.uint8)
        seen = rgb[beside].astype(np.float64)
        squares += float(np.square(plate[beside] - seen).sum())
        spread += float(np.square(seen - seen.mean(axis=0, keepdims=True)).sum()) if len(seen) else 0.0
        pixels += seen.size
        plates.append(plate)
        colours.append((gain, offset))
    psnr_db = 10.0 * np.log10(255.0**2 / max(squares / max(pixels, 1), 1e-9))
    if psnr_db < PLATE_PSNR_DB and squares > (1.0 - PLATE_SHARE_MIN) * spread:
        raise AvatarError(
            f"Where no person is, the scene looks unlike the photos ({psnr_db:.1f} dB, with what colours fit best): "
            "is it this place, in the frame of the footage's cameras?"
        )
    note = f"where no person is, the scene looks like the photos to {psnr_db:.1f} dB."
    return replace(person, plates=tuple(plates), plate_colours=np.array(colours), notes=(*person.notes, note))


def _drawn(person: FilmedPerson, number: int, scenes: Sequence[PackedScene]) -> UInt8Array:
    drawer = CpuRasterizer(scenes, {}, person.K_px[number], *person.mask[number].shape)
    return drawer.render([View(T_world_camera=person.T_world_camera[number], humans=())])[0].rgb


def _photo_colours(drawn: UInt8Array, photo: UInt8Array, beside: BoolArray) -> tuple[Float64Array, Float64Array]:
    """Gain and offset, in 0..1, of each channel (3,) that are best beside the person; none where little is beside."""
    gain, offset = np.ones(3), np.zeros(3)
    if beside.sum() >= _BESIDE_MIN:
        for channel in range(3):
            x, y = (image[..., channel][beside].astype(np.float64) / 255.0 for image in (drawn, photo))
            rows: Float64Array = np.stack([x, np.ones(len(x))], axis=1)
            gain[channel], offset[channel] = np.linalg.lstsq(rows, y, rcond=None)[0]
    return gain, offset
