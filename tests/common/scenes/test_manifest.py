import hashlib
from pathlib import Path

import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.common.maps import GridFrame
from readygo.common.scenes import load_scene
from readygo.common.scenes.manifest import combined_hash, file_of, grid_digest


def test_folder_that_is_no_bundle_says_how_to_make_one(tmp_path):
    for path in (tmp_path, tmp_path / "none"):
        with pytest.raises(SceneError, match="readygo scene import"):
            load_scene(path)


@pytest.mark.parametrize(
    ("name", "file", "words"),
    [
        ("lobby.PLY", "", "make one of it with `readygo scene import .*lobby.PLY --out NEW`"),
        ("data", "shard-r0-00000.mcap", "is a data folder, not a scene"),
        ("policy", "policy.toml", "is a policy, not a scene"),
        ("rl", "state_policy.toml", "is a policy, not a scene"),
    ],
)
def test_what_is_taken_for_a_scene_is_named(name, file, words, tmp_path):
    (tmp_path / name / file).parent.mkdir(exist_ok=True)
    (tmp_path / name / file).touch()
    with pytest.raises(SceneError, match=words):
        load_scene(tmp_path / name)


@pytest.mark.parametrize("name", ["embeded", "Embedded", "embeddded:3"])
def test_misspelt_embedded_scene_is_suggested(name):
    with pytest.raises(SceneError, match=rf"^{name} does not exist \(did you mean embedded\?\)\.$"):
        load_scene(Path(name))


def test_missing_or_cut_files_are_named(copy):
    (copy / "maps" / "human.png").unlink()
    with pytest.raises(SceneError, match=r"human\.png is missing"):
        load_scene(copy)
    (copy / "maps" / "human.png").write_bytes(b"")
    with pytest.raises(SceneError, match=r"human\.png has 0 bytes"):
        load_scene(copy)


def test_file_is_described_by_place_hash_and_size(tmp_path):
    (tmp_path / "maps").mkdir()
    (tmp_path / "maps" / "a.bin").write_bytes(b"abc")
    file = file_of(tmp_path, "maps/a.bin")
    assert (file.path, file.size) == ("maps/a.bin", 3)
    assert file.sha256 == hashlib.sha256(b"abc").hexdigest()


def test_digest_of_a_grid_depends_on_cells_kind_shape_and_place():
    cells = np.array([[True, False, True], [False, False, True]])
    frame = GridFrame(origin_x_m=0.0, origin_y_m=1.0, resolution_m=0.05)
    others = [
        grid_digest(~cells, frame),
        grid_digest(cells.astype(np.uint8), frame),
        grid_digest(cells.reshape(3, 2), frame),
        grid_digest(cells, GridFrame(origin_x_m=0.0, origin_y_m=1.0, resolution_m=0.1)),
        grid_digest(cells, GridFrame(origin_x_m=1.0, origin_y_m=1.0, resolution_m=0.05)),
    ]
    assert len({grid_digest(cells, frame), *others}) == 6
    assert grid_digest(np.asfortranarray(cells), frame) == grid_digest(cells, frame)


def test_combined_hash_depends_on_names_and_digests_and_not_on_their_order():
    assert combined_hash({"a": "1", "b": "2"}) == combined_hash({"b": "2", "a": "1"})
    assert combined_hash({"a": "1", "b": "2"}) != combined_hash({"a": "2", "b": "1"})


@pytest.mark.parametrize("text", ["a = " + "[" * 100_000, "a = " + "9" * 5000, "a" + ".a" * 9000 + " = 1"])
def test_manifest_beyond_a_limit_is_refused(tmp_path, text):
    (tmp_path / "scene.toml").write_text(text)
    with pytest.raises(SceneError, match=r"scene\.toml cannot be read"):
        load_scene(tmp_path)


def test_file_of_a_name_that_no_file_can_have_is_missing(copy):
    text = (copy / "scene.toml").read_text()
    (copy / "scene.toml").write_text(text + '\n[files."' + "a" * 300 + '"]\nsize = 3\nsha256 = "00"\n')
    with pytest.raises(SceneError, match="is missing"):
        load_scene(copy)
