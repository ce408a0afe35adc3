"""Targets: readers of scenes, avatars, maps, pictures and policies."""

import dataclasses
import json
import pickle
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np

from readygo.benchmarks.planning.movingai import load_movingai_map
from readygo.common.avatars import load_avatars
from readygo.common.avatars.file import load_avatar, save_avatar
from readygo.common.avatars.importers.gltf_human import gltf_human
from readygo.common.avatars.importers.hugs import CHECKPOINT_KEYS, load_checkpoint
from readygo.common.avatars.importers.smpl_model import load_smpl_model
from readygo.common.camera.captured import load_views
from readygo.common.documents import write_toml
from readygo.common.errors import ReadygoError, SceneError
from readygo.common.gaussians import save_ply
from readygo.common.gaussians.checkpoint import load_data_transform
from readygo.common.gaussians.files import read_source
from readygo.common.images.encoded import decode_image
from readygo.common.maps.grid import GridFrame, OccupancyMap
from readygo.common.maps.ros_map import load_ros_map, load_unknown_cells, save_ros_map
from readygo.common.policy import load_policy
from readygo.common.policy.artifact import load_spec
from readygo.common.rasterizer.packed.scene import load_packed, pack_cloud, save_packed
from readygo.common.scenes import load_scene
from readygo.services.animator.smpl.refine import load_pose_prior
from readygo.services.reconstructor.frames.exif import read_exif
from tests.common.avatars.importers.humans import smpl_entries, write_glb, write_smpl_pickle
from tests.common.conftest import _cloud
from tests.common.gaussians import other_formats, test_compressed_ply
from tests.common.policy.artifacts import write_policy
from tests.fuzz import mutate
from tests.fuzz.run import Seed, Target
from tests.services.reconstructor.frames.test_exif import exif

ROOT = Path(__file__).resolve().parents[2]
Write = Callable[[Path], Sequence[Path]]


def of_file(name: str, write: Write, read: Callable[[Path], object], how: mutate.Mutate) -> Target:
    """A reader of one file.

    Args:
        name: Of the target.
        write: Writes valid files into a folder.
        read: Reads one.
        how: How inputs are made of them.
    """

    def seeds(folder: Path) -> list[Seed]:
        written = folder / "written"
        written.mkdir()
        return [Seed(path.read_bytes(), path.name) for path in write(written)]

    def read_in(data: bytes, name: str, folder: Path) -> object:
        path = folder / name
        path.write_bytes(data)
        return read(path)

    return Target(name=name, seeds=seeds, read=read_in, mutate=how)


def in_folder(
    name: str, write: Callable[[Path], Path], file: str, read: Callable[[Path], object], how: mutate.Mutate
) -> Target:
    """A reader of one file of a folder, whose other files stay as they are."""

    def seeds(folder: Path) -> list[Seed]:
        made = write(folder / "made")
        return [Seed((made / file).read_bytes(), made)]

    def read_in(data: bytes, made: Path, folder: Path) -> object:
        (made / file).write_bytes(data)
        return read(made)

    return Target(name=name, seeds=seeds, read=read_in, mutate=how)


def _avatars(folder: Path) -> list[Path]:
    whole = next(iter(load_avatars().values()))
    few = np.arange(0, len(whole.cloud), len(whole.cloud) // 20)
    avatar = dataclasses.replace(
        whole, cloud=whole.cloud.select(few), lbs_index=whole.lbs_index[few], lbs_weight=whole.lbs_weight[few]
    )
    for name, quantise in (("a.npz", True), ("b.npz", False)):
        save_avatar(avatar, folder / name, quantise=quantise)
    return [folder / "a.npz", folder / "b.npz"]


def _priors(folder: Path) -> list[Path]:
    rng = np.random.default_rng(0)
    data = {"means": rng.normal(size=(1, 69)), "covars": np.eye(69)[None], "weights": np.ones(1)}
    np.savez_compressed(folder / "p.npz", **data)
    (folder / "p.pkl").write_bytes(pickle.dumps(data, protocol=2))
    return [folder / "p.npz", folder / "p.pkl"]


def _checkpoints(folder: Path) -> list[Path]:
    return [other_formats.write_gsplat(_cloud(4, coefficients=4), folder / "ckpt_29999_rank0.pt")]


def _hugs(folder: Path) -> list[Path]:
    import torch

    parts = {name: {"weight": torch.ones(2)} for name in CHECKPOINT_KEYS}
    torch.save({**parts, "xyz": torch.zeros(3, 3)}, folder / "human_final.pth")
    return [folder / "human_final.pth"]


def _plies(folder: Path) -> list[Path]:
    save_ply(_cloud(4, coefficients=4), folder / "a.ply")
    save_ply(_cloud(3), folder / "b.ply")
    return [folder / "a.ply", folder / "b.ply"]


def _compressed(folder: Path) -> list[Path]:
    rows = [[0x12345678, 0x3FF00000, 0x7FFFFFFF, 0xFF8040FF]] * 3
    chunk = [[*test_compressed_ply.CHUNK, 0, 0, 0, 1, 1, 1]]
    sh = np.full((3, 9), 128, np.uint8)
    return [
        test_compressed_ply.write(folder / "a.compressed.ply", chunk, rows),
        test_compressed_ply.write(folder / "b.compressed.ply", chunk, rows, sh=sh),
    ]


def _spzs(folder: Path) -> list[Path]:
    cloud = _cloud(4, coefficients=4)
    return [
        *(other_formats.write_spz(cloud, folder / f"{version}.spz", version=version) for version in (1, 2, 3)),
        other_formats.write_spz4(cloud, folder / "4.spz"),
    ]


def _splats(folder: Path) -> list[Path]:
    return [other_formats.write_splat(_cloud(8), folder / "a.splat")]


def _pictures(folder: Path) -> list[Path]:
    rgb = np.random.default_rng(0).integers(0, 255, (9, 12, 3), np.uint8)
    for name, pixels in (
        ("a.png", rgb),
        ("b.jpg", rgb),
        ("c.png", rgb[..., 0]),
        ("d.png", rgb.astype(np.uint16) * 200),
    ):
        cv2.imwrite(str(folder / name), pixels)
    return sorted(folder.iterdir())


def _read_picture(path: Path) -> None:
    if decode_image(path.read_bytes()) is None:
        raise ReadygoError("it cannot be decoded")


def _views(folder: Path) -> list[Path]:
    rows = [other_formats.camera_row(k, np.eye(4)) for k in range(2)]
    (folder / "cameras.json").write_text(json.dumps(rows))
    return [folder / "cameras.json"]


def _transform(folder: Path) -> list[Path]:
    (folder / "t.json").write_text(json.dumps({"transform": np.eye(4)[:3].tolist(), "scale": 0.5}))
    return [folder / "t.json"]


def _glbs(folder: Path) -> list[Path]:
    return [write_glb(folder / "a.glb"), write_glb(folder / "b.glb", texture=False, posed=True)]


def _gltf(folder: Path) -> list[Path]:
    data = write_glb(folder / "a.glb", texture=False).read_bytes()
    size = int.from_bytes(data[12:16], "little")
    document = json.loads(data[20 : 20 + size])
    (folder.parent / "a.bin").write_bytes(data[28 + size :])
    document["buffers"][0]["uri"] = "a.bin"
    (folder / "a.gltf").write_text(json.dumps(document))
    return [folder / "a.gltf"]


def _read_glb(path: Path) -> None:
    gltf_human(path, count=100)


def _smpl_npzs(folder: Path) -> list[Path]:
    entries = {name: value for name, value in smpl_entries(betas=1).items() if name != "posedirs"}
    entries["J_regressor"] = entries["J_regressor"].toarray()
    np.savez_compressed(folder / "m.npz", **{name: np.asarray(value) for name, value in entries.items()})
    return [folder / "m.npz"]


def _smpl_pickles(folder: Path) -> list[Path]:
    return [
        write_smpl_pickle(folder / "m.pkl", drop=("posedirs",)),
        write_smpl_pickle(folder / "n.pkl", protocol=0, drop=("posedirs",)),
    ]


def _ros_maps(folder: Path) -> Path:
    folder.mkdir()
    frame = GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.05)
    save_ros_map(
        OccupancyMap(frame=frame, occupied=np.eye(8, 6).astype(np.bool_)), folder / "map.yaml", picture_format="pgm"
    )
    return folder


def _read_ros_map(folder: Path) -> None:
    load_ros_map(folder / "map.yaml")
    load_unknown_cells(folder / "map.yaml")


def _movingai(folder: Path) -> list[Path]:
    (folder / "a.map").write_text("type octile\nheight 3\nwidth 4\nmap\n....\n.@T.\nSW..\n")
    return [folder / "a.map"]


def _scene(folder: Path) -> Path:
    """What a manifest names, empty: no file is opened before the manifest is believed."""
    from readygo.common.scenes.manifest import FORMAT, combined_hash

    folder.mkdir()
    (folder / "cloud.ply").write_bytes(b"ply")
    manifest = {
        "format": FORMAT,
        "name": "room",
        "license": "CC0-1.0",
        "content": {"cloud": "ab", "floor": "cd"},
        "content_hash": combined_hash({"cloud": "ab", "floor": "cd"}),
        "files": {"cloud.ply": {"size": 3, "sha256": "00"}},
        "floor": {"origin_x_m": 0.0, "origin_y_m": 0.0, "resolution_m": 0.05},
        "maps": {"resolution_m": 0.05},
        "source": {"scale": 1.0},
    }
    write_toml(folder / "scene.toml", manifest, raises=SceneError)
    return folder


def _read_scene(folder: Path) -> None:
    scene = load_scene(folder)
    assert scene.license is not None
    assert scene.reconstruction is None or scene.views is None


def _packed(folder: Path) -> Path:
    save_packed(pack_cloud(_cloud(20, coefficients=4)), folder)
    return folder


def _exifs(folder: Path) -> list[Path]:
    for order in "<>":
        (folder / f"{'le' if order == '<' else 'be'}.jpg").write_bytes(exif(order, 6, 26))
    return sorted(folder.iterdir())


def _policy(folder: Path) -> Path:
    return write_policy(folder)


ARCHIVE = mutate.zipped(mutate.npy)
TARGETS = [
    of_file("avatar .npz", _avatars, load_avatar, ARCHIVE),
    of_file("SMPL .npz", _smpl_npzs, load_smpl_model, ARCHIVE),
    of_file("SMPL pickle", _smpl_pickles, load_smpl_model, mutate.binary),
    of_file("HUGS checkpoint", _hugs, load_checkpoint, mutate.zipped(mutate.binary)),
    of_file(
        "pose prior",
        _priors,
        load_pose_prior,
        lambda data, dice: (ARCHIVE if data[:2] == b"PK" else mutate.binary)(data, dice),
    ),
    of_file("glTF .glb", _glbs, _read_glb, mutate.glb),
    of_file("glTF .gltf", _gltf, _read_glb, mutate.json_text),
    of_file(".ply", _plies, read_source, mutate.binary),
    of_file(".compressed.ply", _compressed, read_source, mutate.binary),
    of_file(".splat", _splats, read_source, mutate.binary),
    of_file(".spz", _spzs, read_source, mutate.gzipped),
    of_file("Gaussian checkpoint", _checkpoints, read_source, mutate.zipped(mutate.binary)),
    of_file("dataparser_transforms.json", _transform, load_data_transform, mutate.json_text),
    of_file("cameras.json", _views, load_views, mutate.json_text),
    of_file("PNG and JPEG", _pictures, _read_picture, mutate.png),
    of_file("EXIF", _exifs, read_exif, mutate.binary),
    of_file("MovingAI map", _movingai, lambda path: load_movingai_map(path, 0.2), mutate.text),
    in_folder("ROS map .yaml", _ros_maps, "map.yaml", _read_ros_map, mutate.text),
    in_folder("ROS map picture", _ros_maps, "map.pgm", _read_ros_map, mutate.binary),
    in_folder("scene.toml", _scene, "scene.toml", _read_scene, mutate.text),
    in_folder("packed scene .npy", _packed, "centre_m.npy", load_packed, mutate.npy),
    in_folder("packed.json", _packed, "packed.json", load_packed, mutate.json_text),
    in_folder("policy.toml", _policy, "policy.toml", load_spec, mutate.text),
    in_folder("ONNX policy", _policy, "policy.onnx", load_policy, mutate.binary),
]
