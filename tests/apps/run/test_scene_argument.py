from readygo.apps.run.scene_argument import open_maps


def test_ros_map_lies_on_a_flat_floor(place) -> None:
    maps, scene = open_maps(place)
    assert scene is None
    assert maps.robot is maps.human
    assert maps.floor.height_m.max() == 0.0
