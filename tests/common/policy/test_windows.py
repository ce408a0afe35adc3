from hypothesis import given
from hypothesis import strategies as st

from readygo.common.policy.windows import window_at, window_rows


def test_window_is_oldest_first_and_repeats_the_first_row() -> None:
    assert window_rows([0, 7, 25], [0, 0, 0], 10).tolist() == [[0, 0, 0], [0, 0, 7], [5, 15, 25]]
    assert window_rows(31, 20, 10).tolist() == [20, 21, 31]
    assert window_rows(31, 0, 10, 5).tolist() == [0, 1, 11, 21, 31]
    assert window_rows(31, 0, 10, 1).tolist() == [31]


def test_rows_between_two_images_see_the_older_one() -> None:
    assert window_rows([29, 30, 31, 32], 0, 15, 2, image_every=3).tolist() == [[12, 27], [15, 30], [15, 30], [15, 30]]
    assert window_rows(34, 2, 15, 3, image_every=3).tolist() == [2, 17, 32]


@given(st.integers(0, 60), st.integers(1, 12), st.integers(1, 5))
def test_images_at_every_step_are_chosen_as_rows_are(newest: int, spacing: int, count: int) -> None:
    times_ns = [50 * row for row in range(newest + 1)]
    assert window_at(times_ns, 50 * spacing, count) == window_rows(newest, 0, spacing, count).tolist()


def test_image_that_is_nearest_in_time_is_chosen_and_the_older_of_two() -> None:
    assert window_at([0, 400, 480, 1000], 500, 3) == [0, 2, 3]
    assert window_at([0, 400, 600, 1000], 500, 2) == [1, 3]
