import numpy as np
import pytest

from readygo.common.errors import ConfigError, SceneError
from readygo.services.reconstructor.metric.config import MetricConfig
from readygo.services.reconstructor.metric.lengths import parse_length
from readygo.services.reconstructor.metric.place import Device, place_map, ruler_of
from readygo.services.reconstructor.similarity import Similarity
from tests.services.reconstructor.metric.test_lengths import ENDS, picked
from tests.services.reconstructor.synthetic import floor_points, mapped, marker_at, ring, sighted, some_similarity

POSES = ring()
IMAGES = mapped(POSES, floor_points(), some_similarity())
SEEN = sighted(POSES, marker_at(), 0, 0.05)


def test_floor_marker_makes_the_map_metric_with_z_up_from_the_floor() -> None:
    placed = place_map(IMAGES, SEEN, [], MetricConfig(marker_size_m=0.2))
    world = IMAGES.transform(placed.world_from_map)
    np.testing.assert_allclose(world.T_world_camera[:, :3, 3], POSES[:, :3, 3], atol=0.01)
    assert placed.floor.source == "marker 0 on the floor"


def leaning(deg: float) -> np.ndarray:
    """Corners of a marker that lies on a slope in the middle of the floor."""
    return marker_at() @ leaning_rotation(deg).T


def leaning_rotation(deg: float) -> np.ndarray:
    c, s = np.cos(np.radians(deg)), np.sin(np.radians(deg))
    return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])


def test_marker_on_a_slope_gives_way_to_the_floor_and_a_note_says_so() -> None:
    seen = sighted(POSES, leaning(2.0), 0, 0.05)
    placed = place_map(IMAGES, seen, [], MetricConfig(marker_size_m=0.2))
    world = IMAGES.transform(placed.world_from_map)
    np.testing.assert_allclose(world.T_world_camera[:, 2, 3], 1.4, atol=0.01)
    assert placed.floor.source.startswith("floor plane of the points; marker 0 leans 2.")
    assert any("more than their own uncertainty" in note for note in placed.warnings)
    on_purpose = place_map(IMAGES, seen, [], MetricConfig(marker_size_m=0.2, marker_on="floor"))
    assert on_purpose.floor.source == "marker 0 on the floor"


def test_marker_stays_up_where_the_cameras_were_held_as_it_says() -> None:
    ramp = floor_points() @ leaning_rotation(12.0).T
    placed = place_map(mapped(POSES, ramp, some_similarity()), SEEN, [], MetricConfig(marker_size_m=0.2))
    assert placed.floor.source == "marker 0 on the floor"
    assert any(note.startswith("check: the floor's points") for note in placed.warnings)


def test_scale_alone_takes_up_from_the_floors_points() -> None:
    placed = place_map(IMAGES, [], [], MetricConfig(scale=1.0 / some_similarity().scale))
    world = IMAGES.transform(placed.world_from_map)
    np.testing.assert_allclose(world.T_world_camera[:, 2, 3], 1.4, atol=0.02)
    assert np.isnan(placed.scale.sigma)


def test_wall_marker_gives_scale_but_not_up() -> None:
    upright = marker_at()[:, [0, 2, 1]] * [1, 1, 1] + [0, 0, 0.5]
    placed = place_map(IMAGES, sighted(POSES, upright, 0, 0.05), [], MetricConfig(marker_size_m=0.2))
    assert placed.floor.source == "floor plane of the points"
    np.testing.assert_allclose(placed.scale.metres_per_unit * some_similarity().scale, 1.0, rtol=5e-3)


def test_length_gives_the_scale_and_beside_a_marker_checks_it() -> None:
    known = parse_length(picked((0, 4, 8), float(np.linalg.norm(ENDS[1] - ENDS[0]))))
    alone = place_map(IMAGES, [], [known], MetricConfig())
    np.testing.assert_allclose(alone.scale.metres_per_unit * some_similarity().scale, 1.0, rtol=1e-5)
    both = place_map(IMAGES, SEEN, [known], MetricConfig(marker_size_m=0.2))
    assert any(note.startswith("check: the length of") for note in both.warnings)


def test_marker_of_the_wrong_size_is_found_by_a_second_length() -> None:
    known = parse_length(picked((0, 4, 8), float(np.linalg.norm(ENDS[1] - ENDS[0]))))
    with pytest.raises(SceneError, match=r"contradict each other.*printed size"):
        place_map(IMAGES, SEEN, [known], MetricConfig(marker_size_m=0.15))


def test_second_length_may_differ_by_the_drift_of_a_long_map() -> None:
    off = parse_length(picked((0, 4, 8), 1.05 * float(np.linalg.norm(ENDS[1] - ENDS[0]))))
    config = MetricConfig(marker_size_m=0.2)
    with pytest.raises(SceneError, match=r"contradict each other"):
        place_map(IMAGES, SEEN, [off], config, find_drift=lambda ruler: 0.001)
    asked = []
    bent = place_map(IMAGES, SEEN, [off], config, find_drift=lambda ruler: asked.append(ruler.images) or 0.03)
    assert asked == [set(IMAGES.names)]
    assert bent.scale.drift == 0.03
    assert any(note.startswith("check: the length of") for note in bent.warnings)
    with pytest.raises(SceneError, match=r"contradict each other"):
        place_map(IMAGES, SEEN, [off], config, find_drift=lambda ruler: None)
    unknown = place_map(IMAGES, SEEN, [], config, find_drift=lambda ruler: None)
    assert unknown.scale.drift == 0.0
    assert unknown.warnings[-1].endswith("how far the map is bent cannot be told")


def test_marker_that_does_not_tell_the_scale_is_neither_ruler_nor_floor() -> None:
    odd = sighted(POSES, marker_at((0.5, 0.0, 0.4), 0.15), 0, 0.001)
    others = [sighted(POSES, marker_at((x, 0.5, 0.0)), n, 0.1) for n, x in ((1, 0.0), (2, 0.3))]
    seen, measured = [*odd, *others[0], *others[1]], []
    config = MetricConfig(marker_size_m=0.2)
    placed = place_map(IMAGES, seen, [], config, find_drift=lambda ruler: measured.append(ruler.measure(IMAGES)) or 0.0)
    assert min(placed.markers, key=lambda measure: measure.sigma).marker == 0
    assert placed.scale.markers == (1, 2)
    np.testing.assert_allclose(measured, 0.2 * some_similarity().scale, rtol=3e-3)
    assert placed.floor.source in ("marker 1 on the floor", "marker 2 on the floor")
    world = IMAGES.transform(placed.world_from_map)
    np.testing.assert_allclose(world.T_world_camera[:, 2, 3], 1.4, atol=0.02)


def test_cameras_at_a_strange_height_make_the_size_doubtful() -> None:
    placed = place_map(IMAGES, SEEN, [], MetricConfig(marker_size_m=0.02))
    assert any("check the marker's size" in note for note in placed.warnings)
    given = place_map(IMAGES, [], [], MetricConfig(scale=0.1 / some_similarity().scale))
    assert any(note.endswith("check the scale that was given") for note in given.warnings)
    length = parse_length(picked((0, 4, 8), 0.1 * float(np.linalg.norm(ENDS[1] - ENDS[0]))))
    measured = place_map(IMAGES, [], [length], MetricConfig())
    assert any(note.endswith("check the lengths") for note in measured.warnings)


def test_marker_that_is_asked_for_and_not_there_is_named() -> None:
    with pytest.raises(SceneError, match=r"Marker 7 .* is in no image; found: 0"):
        place_map(IMAGES, SEEN, [], MetricConfig(marker_size_m=0.2, marker_ids=(7,)))


def test_no_scale_is_refused() -> None:
    with pytest.raises(ConfigError, match="Nothing tells the scale"):
        place_map(IMAGES, [], [], MetricConfig())


def test_ruler_is_the_best_marker_else_the_first_length_and_none_where_the_scale_was_given() -> None:
    seen = SEEN[:5] + sighted(POSES, marker_at((0.5, 0.0, 0.0)), 1, 0.001)
    placed = place_map(IMAGES, seen, [], MetricConfig(marker_size_m=0.2))
    ruler = ruler_of(placed.markers, seen, [])
    assert ruler is not None
    assert ruler.images == set(IMAGES.names)
    np.testing.assert_allclose(ruler.measure(IMAGES), 0.2 * some_similarity().scale, rtol=1e-3)
    known = parse_length(picked((0, 4, 8), float(np.linalg.norm(ENDS[1] - ENDS[0]))))
    length = ruler_of([], [], [known])
    assert length is not None
    assert length.images == {IMAGES.names[number] for number in (0, 4, 8)}
    np.testing.assert_allclose(length.measure(IMAGES), known.length_m * some_similarity().scale, rtol=1e-4)
    assert ruler_of([], [], []) is None


def test_device_gives_the_scale_where_nothing_else_does_and_is_checked_by_a_marker() -> None:
    metres = mapped(POSES, floor_points(), Similarity(scale=1.0, R=some_similarity().R, t=np.zeros(3)))
    device = Device(name="Polycam", metric=True, up=some_similarity().R[:, 2])
    placed = place_map(metres, [], [], MetricConfig(), device)
    assert placed.scale.source == "the device (Polycam)"
    assert np.isnan(placed.scale.sigma)
    np.testing.assert_allclose(metres.transform(placed.world_from_map).T_world_camera[:, 2, 3], 1.4, atol=0.02)
    marked = place_map(metres, SEEN, [], MetricConfig(marker_size_m=0.2), device)
    assert marked.scale.source.startswith("marker 0")
    assert any("than by the device (Polycam)" in note for note in marked.warnings)


def test_up_of_a_device_holds_where_cameras_were_not_held_level() -> None:
    T = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    rolled = POSES.copy()
    rolled[:, :3, :3] = rolled[:, :3, :3] @ T
    bare = mapped(rolled, floor_points(6), some_similarity())
    config = MetricConfig(scale=1.0 / some_similarity().scale)
    up = place_map(bare, [], [], config, Device(up=some_similarity().R[:, 2])).floor.up
    np.testing.assert_allclose(up, some_similarity().R[:, 2], atol=1e-9)
    assert place_map(bare, [], [], config).floor.up @ some_similarity().R[:, 2] < 0.9


def test_depths_of_a_device_tell_the_scale_of_poses_without_one_and_are_checked() -> None:
    device = Device(name="depth images of x", metric=True, metres_per_unit=1.0 / some_similarity().scale)
    placed = place_map(IMAGES, [], [], MetricConfig(), device)
    assert placed.scale.source == "the device (depth images of x)"
    assert placed.scale.metres_per_unit == 1.0 / some_similarity().scale
    marked = place_map(IMAGES, SEEN, [], MetricConfig(marker_size_m=0.2), device)
    note = next(note for note in marked.warnings if "than by the device" in note)
    assert abs(float(note.split()[3])) < 0.2
