"""Small 3DGS .ply files."""

import numpy as np

FIELDS = [
    "x",
    "y",
    "z",
    "f_dc_0",
    "f_dc_1",
    "f_dc_2",
    "opacity",
    "scale_0",
    "scale_1",
    "scale_2",
    "rot_0",
    "rot_1",
    "rot_2",
    "rot_3",
]


def write_ply(path, fields, rows, *, count=None, form="binary_little_endian 1.0"):
    header = ["ply", f"format {form}", f"element vertex {len(rows) if count is None else count}"]
    header += [f"property float {name}" for name in fields] + ["end_header"]
    path.write_bytes(("\n".join(header) + "\n").encode() + np.asarray(rows, "<f4").tobytes())
    return path


def good_row():
    return [0.0, 0, 0, 0, 0, 0, 0, -3, -3, -3, 1, 0, 0, 0]
