"""Cameras as other programs read them: COLMAP's text model, and `transforms.json` of nerfstudio.

Legend: q = rotation world to camera as a quaternion, t = its translation, both with OpenCV axes (COLMAP). The matrices
of `transforms.json` map from the camera, with OpenGL axes (y up, z backward), to the world.

Source: COLMAP's documentation, "Output format"; nerfstudio's documentation, "Data conventions".
"""

import json

import numpy as np

from readygo.common.arrays import Float64Array, UInt8Array
from readygo.common.camera.captured import CapturedViews
from readygo.common.errors import SceneError
from readygo.common.frames import quat_from_matrix, swap_opengl_axes

IMAGES = "images"
"""Folder of the images beside `transforms.json`."""
TRANSFORMS_FILE = "transforms.json"


def colmap_texts(views: CapturedViews, points_m: Float64Array, points_rgb: UInt8Array) -> dict[str, str]:
    """Cameras and points as COLMAP's text model.

    Args:
        views: The cameras; those with the same lens become one.
        points_m: Points, which no image is said to see, shape (P, 3) [m].
        points_rgb: Their colours, shape (P, 3).

    Returns:
        Text by the name of its file.

    Raises:
        SceneError: If the name of an image has a space, which ends names there.
    """
    spaced = [name for name in views.images if len(name.split()) != 1]
    if spaced:
        raise SceneError(f"COLMAP's text model has no spaces in names of images, got {spaced[0]!r}; rename them.")
    lenses = [
        (*size.tolist(), K[0, 0], K[1, 1], K[0, 2], K[1, 2]) for size, K in zip(views.sizes_px, views.K_px, strict=True)
    ]
    number_of = {lens: number for number, lens in enumerate(dict.fromkeys(lenses), start=1)}
    cameras = [f"{number} PINHOLE {' '.join(_word(value) for value in lens)}" for lens, number in number_of.items()]
    images = []
    for row, (name, lens) in enumerate(zip(views.images, lenses, strict=True), start=1):
        T = np.linalg.inv(views.T_world_camera[row - 1])
        numbers = [*quat_from_matrix(T[:3, :3]).tolist(), *T[:3, 3].tolist()]
        # The second line has the image's points: there are none.
        images += [f"{row} {' '.join(map(_word, numbers))} {number_of[lens]} {name}", ""]
    points = [
        f"{row} {' '.join(_word(value) for value in p)} {r} {g} {b} 0"
        for row, (p, (r, g, b)) in enumerate(zip(points_m.tolist(), points_rgb.tolist(), strict=True), start=1)
    ]
    texts = {"cameras.txt": cameras, "images.txt": images, "points3D.txt": points}
    return {name: "".join(f"{line}\n" for line in lines) for name, lines in texts.items()}


def transforms_text(views: CapturedViews) -> str:
    """Cameras as `transforms.json`: a pinhole lens for each frame, images in `images/`."""
    frames = []
    for name, size, K, T in zip(views.images, views.sizes_px, views.K_px, views.T_world_camera, strict=True):
        lens = {"fl_x": K[0, 0], "fl_y": K[1, 1], "cx": K[0, 2], "cy": K[1, 2]}
        frames.append(
            {
                "file_path": f"{IMAGES}/{name}",
                "transform_matrix": swap_opengl_axes(T).tolist(),
                **{key: float(value) for key, value in lens.items()},
                "w": int(size[0]),
                "h": int(size[1]),
            }
        )
    return json.dumps({"camera_model": "PINHOLE", "frames": frames}, indent=1) + "\n"


def _word(value: float) -> str:
    """A number that comes back the same: whole ones without a point."""
    return repr(int(value)) if float(value).is_integer() and abs(value) < 2**53 else repr(float(value))
