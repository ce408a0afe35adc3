import numpy as np
import pytest

from readygo.common.errors import SceneError
from readygo.common.scenes import load_scene, verify_scene
from tests.common.scenes.small_room import small_room


def test_loaded_scene_has_what_was_saved(scene):
    loaded = load_scene(scene.path)
    assert (loaded.name, loaded.content_hash) == ("small", scene.content_hash)
    assert loaded.license == "CC0"
    np.testing.assert_array_equal(loaded.cloud.means_m, small_room().means_m)
    assert loaded.sky is not None
    assert len(loaded.sky) == 100
    row, column = loaded.maps.robot.frame.cell(1.2, 1.02)
    assert loaded.maps.robot.occupied[row, column]
    assert loaded.maps.human.occupied[row, column]
    assert loaded.maps.floor.at(3.0, 2.0) == pytest.approx(0.0, abs=0.01)
    assert loaded.maps.robot is loaded.maps.robot


def test_maps_load_without_the_gaussians(scene):
    loaded = load_scene(scene.path)
    _ = loaded.maps.robot, loaded.maps.human, loaded.maps.floor
    assert "cloud" not in loaded.__dict__
    assert "sky" not in loaded.__dict__


def test_files_of_a_scene_make_a_copy_that_loads(scene, tmp_path):
    for file in scene.files:
        target = tmp_path / "copy" / file.path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes((scene.path / file.path).read_bytes())
        assert target.stat().st_size == file.size
    copy = load_scene(tmp_path / "copy")
    assert copy.content_hash == scene.content_hash
    verify_scene(copy)


def test_changed_bytes_are_found_by_verification(copy):
    path = copy / "scene.ply"
    data = bytearray(path.read_bytes())
    data[-1] ^= 1
    path.write_bytes(data)
    with pytest.raises(SceneError, match=r"scene\.ply has changed"):
        verify_scene(load_scene(copy))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("readygo-scene/1", "readygo-scene/9", "format"),
        ('content_hash = "', 'content_hash = "0', "was edited"),
        ("[content]", "[contents]", "incomplete"),
        ("[floor]", "[flour]", "incomplete"),
        ('name = "', "name = ", "cannot be read"),
    ],
)
def test_broken_manifest_is_refused_in_one_line(copy, old, new, message):
    path = copy / "scene.toml"
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(SceneError, match=message) as caught:
        load_scene(copy)
    assert "\n" not in str(caught.value)


def test_wall_hides_what_is_behind_it(scene):
    sight = load_scene(scene.path).maps.sight
    assert sight.sees(0.5, 1.5, 0.4, (3.0, 2.0))
    assert not sight.sees(0.5, 1.5, 0.4, (-0.4, 1.5))


def test_damaged_floor_map_is_refused_with_its_name(copy):
    floor = copy / "maps" / "floor_height_m.npy"
    floor.write_bytes(b"x" * floor.stat().st_size)
    with pytest.raises(SceneError, match=r"floor_height_m\.npy is not a readable NumPy array.*import the scene again"):
        _ = load_scene(copy).maps.floor
