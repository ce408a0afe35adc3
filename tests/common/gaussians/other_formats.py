"""Writers of the formats that other programs make, after their published layouts and not after the readers."""

import gzip
import json
import struct

import numpy as np

SQRT_HALF = 0.5**0.5
SH_COUNT = {1: 0, 4: 1, 9: 2, 16: 3}


def write_splat(cloud, path):
    """antimatter15/splat, convert.py: bytes are cut off, not rounded."""
    with path.open("wb") as file:
        rgb = 0.5 + 0.28209479177387814 * cloud.sh[:, 0]
        rgba = np.concatenate([rgb, cloud.opacities[:, None]], axis=1)
        rows = np.empty((len(cloud), 32), np.uint8)
        rows[:, :12] = cloud.means_m.astype("<f4").view(np.uint8)
        rows[:, 12:24] = cloud.scales_m.astype("<f4").view(np.uint8)
        rows[:, 24:28] = (rgba * 255).clip(0, 255)
        rows[:, 28:32] = (cloud.quats_wxyz * 128 + 128).clip(0, 255)
        file.write(rows.tobytes())
    return path


def spz_bytes(cloud, *, version=3, fractional_bits=12, count=None, sh_bits=(5, 4), tail=b""):
    """nianticlabs/spz, load-spz.cc: `packGaussians` and `serializePackedGaussians`, before gzip."""
    n, degree = len(cloud), SH_COUNT[cloud.sh.shape[1]]
    header = struct.pack("<IIIBBBB", 0x5053474E, version, n if count is None else count, degree, fractional_bits, 0, 0)
    return header + b"".join(spz_attributes(cloud, version, fractional_bits, sh_bits)) + tail


def spz_attributes(cloud, version=4, fractional_bits=12, sh_bits=(5, 4)):
    if version == 1:
        positions = cloud.means_m.astype("<f2").tobytes()
    else:
        fixed = np.round(cloud.means_m.astype(np.float64) * 2**fractional_bits).astype("<i4")
        positions = fixed.reshape(-1, 1).view(np.uint8)[:, :3].tobytes()
    alphas = _byte(cloud.opacities * 255)
    colours = _byte(cloud.sh[:, 0] * (0.15 * 255) + 0.5 * 255)
    scales = _byte((np.log(np.maximum(cloud.scales_m, 1e-30)) + 10) * 16)
    xyzw = cloud.quats_wxyz[:, [1, 2, 3, 0]].astype(np.float64)
    xyzw /= np.linalg.norm(xyzw, axis=1, keepdims=True)
    rotations = smallest_three(xyzw) if version >= 3 else first_three(xyzw)
    return [positions, alphas, colours, scales, rotations, _sh(cloud.sh[:, 1:], sh_bits)]


def _byte(x):
    return np.clip(np.round(x), 0, 255).astype(np.uint8).tobytes()


def first_three(xyzw):
    sign = np.where(xyzw[:, 3:] < 0, -1, 1)
    return _byte(xyzw[:, :3] * sign * 127.5 + 127.5)


def smallest_three(xyzw):
    words = np.empty(len(xyzw), "<u4")
    for k, q in enumerate(xyzw.tolist()):
        largest = max(range(4), key=lambda i: abs(q[i]))
        word = largest
        for i in range(4):
            if i != largest:
                negative = int(q[i] < 0) ^ int(q[largest] < 0)
                word = word << 10 | negative << 9 | int(511 * (abs(q[i]) / SQRT_HALF) + 0.5)
        words[k] = word
    return words.tobytes()


def _sh(rest, bits):
    q = (np.round(rest * 128.0) + 128).astype(np.int64)
    for rows, kept in ((slice(0, 3), bits[0]), (slice(3, None), bits[1])):
        bucket = 1 << (8 - kept)
        q[:, rows] = (q[:, rows] + bucket // 2) // bucket * bucket
    return q.clip(0, 255).astype(np.uint8).tobytes()


def write_spz(cloud, path, **options):
    path.write_bytes(gzip.compress(spz_bytes(cloud, **options)))
    return path


def write_spz4(cloud, path, *, streams=None):
    """Version 4: header, table of sizes, one zstd stream for each attribute; no streams of nothing."""
    import zstandard

    plain = [stream for stream in spz_attributes(cloud) if stream]
    packed = [zstandard.ZstdCompressor().compress(stream) for stream in plain] if streams is None else streams
    header = struct.pack("<IIIBBBBI12x", 0x5053474E, 4, len(cloud), SH_COUNT[cloud.sh.shape[1]], 12, 0, len(packed), 32)
    table = b"".join(struct.pack("<QQ", len(a), len(b)) for a, b in zip(packed, plain, strict=True))
    path.write_bytes(header + table + b"".join(packed))
    return path


def trained(cloud):
    """What trainings optimise, as tensors: logarithms of scales, logits of opacities."""
    import torch

    opacities = torch.from_numpy(cloud.opacities.astype(np.float64))
    parts = {
        "means": torch.from_numpy(cloud.means_m),
        "quats": 3 * torch.from_numpy(cloud.quats_wxyz),
        "scales": torch.from_numpy(cloud.scales_m).log(),
        "opacities": torch.logit(opacities, eps=1e-7).float(),
    }
    return parts, torch.from_numpy(cloud.sh)


def write_gsplat(cloud, path, **more):
    """nerfstudio-project/gsplat, examples/simple_trainer.py: `ckpt_STEP_rankR.pt`."""
    import torch

    parts, sh = trained(cloud)
    path.parent.mkdir(parents=True, exist_ok=True)
    torch.save({"step": 29999, "splats": {**parts, "sh0": sh[:, :1].clone(), "shN": sh[:, 1:].clone(), **more}}, path)
    return path


def write_splatfacto(cloud, folder, step=29999, *, R=None, t=(0, 0, 0), scale=1.0):
    """nerfstudio's output folder; the Gaussians as given, with the transform that is said to have led to them.

    Its schedulers leave a NumPy scalar in the checkpoint. Without view dependence it optimises logits of colours.
    """
    import torch

    parts, sh = trained(cloud)
    dc = sh[:, 0].clone() if sh.shape[1] > 1 else torch.logit(0.5 + 0.28209479177387814 * sh[:, 0], eps=1e-6)
    parts |= {"features_dc": dc, "features_rest": sh[:, 1:].clone()}
    parts["opacities"] = parts["opacities"][:, None]
    pipeline = {f"_model.gauss_params.{name}": tensor for name, tensor in parts.items()}
    state = {"step": step, "pipeline": pipeline, "schedulers": {"means": {"_last_lr": [np.float64(1.6e-6)]}}}
    path = folder / "nerfstudio_models" / f"step-{step:09d}.ckpt"
    path.parent.mkdir(parents=True, exist_ok=True)
    torch.save(state, path)
    if R is not None:
        transform = np.concatenate([R, np.array(t, np.float64)[:, None]], axis=1)
        text = json.dumps({"transform": transform.tolist(), "scale": scale}, indent=4)
        (folder / "dataparser_transforms.json").write_text(text)
    return path


def camera_row(k, T_world_camera, *, width=640, height=480, focal=500.0):
    """graphdeco-inria/gaussian-splatting, utils/camera_utils.py: `camera_to_JSON`."""
    T = np.asarray(T_world_camera)
    return {
        "id": k,
        "img_name": f"frame_{k:05d}",
        "width": width,
        "height": height,
        "position": T[:3, 3].tolist(),
        "rotation": [row.tolist() for row in T[:3, :3]],
        "fy": focal,
        "fx": focal,
    }
