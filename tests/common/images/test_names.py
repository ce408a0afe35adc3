from readygo.common.images.names import camera_of, cameras_of, image_name, images_of, kind_of, kinds_of


def test_images_of_the_first_camera_have_the_names_of_a_single_ones():
    assert [image_name("", "rgb"), image_name("left", "depth")] == ["rgb", "left.depth"]
    assert [(camera_of(name), kind_of(name)) for name in ("rgb", "left.depth")] == [("", "rgb"), ("left", "depth")]


def test_images_are_sorted_by_camera():
    names = images_of(("", "left"), ("rgb", "depth"))
    assert names == ("rgb", "depth", "left.rgb", "left.depth")
    assert cameras_of(names) == ("", "left")
    assert kinds_of("left", names) == ("rgb", "depth")
