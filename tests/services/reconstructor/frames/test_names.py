import random

import pytest

from readygo.services.reconstructor.frames.names import image_order, times_of_names, usable_name


@pytest.mark.parametrize(
    "names",
    [
        ["0.jpg", "1.jpg", "2.jpg", "10.jpg", "100.jpg"],
        ["640x480/IMG_1.jpg", "480x640/IMG_2.jpg", "640x480/IMG_3.jpg", "480x640/IMG_10.jpg"],
        ["view_0/1.jpg", "view_0/10.jpg", "view_1/1.jpg", "view_1/2.jpg"],
    ],
)
def test_numbers_in_names_count_as_numbers(names: list[str]) -> None:
    mixed = random.Random(0).sample(names, len(names))
    assert sorted(mixed, key=image_order) == names


@pytest.mark.parametrize(
    "names",
    [
        [f"{number:06d}.jpg" for number in range(0, 3000, 7)],
        [f"view_{view}/{number:03d}.jpg" for view in range(8) for number in range(12)],
        ["IMG_0001(1).jpg", "IMG_0001.jpg", "IMG_0001_2.jpg", "img.jpg", "img1.jpg", "imgs.jpg"],
    ],
)
def test_numbers_of_equally_many_digits_keep_the_order_of_text(names: list[str]) -> None:
    assert sorted(reversed(names), key=image_order) == sorted(names)


def test_names_that_colmap_reads_hold_no_spaces_and_no_comment() -> None:
    assert usable_name("IMG 0001 (2)\t.jpg") == "IMG_0001_(2)_.jpg"
    assert usable_name("#1 a#b.jpg") == "_1_a#b.jpg"
    assert usable_name("IMG_0001.jpg") == "IMG_0001.jpg"


def test_times_are_the_numbers_at_the_end_of_names_in_usual_spacings() -> None:
    assert times_of_names(["000010.jpg", "000020.jpg", "000030.jpg", "000070.jpg"]).tolist() == [0.0, 1.0, 2.0, 6.0]
    assert times_of_names(["a/f_1.2_7.png", "a/f_1.2_9.png", "a/f_1.2_11.png"]).tolist() == [0.0, 1.0, 2.0]
    for untold in (["b.png", "a.png", "c.png"], ["1.png", "2.png", "2.jpg"], ["a_1.png", "b_2.png", "b_9.png"], ["7"]):
        assert times_of_names(untold).tolist() == list(range(len(untold)))
    assert times_of_names([]).tolist() == []
