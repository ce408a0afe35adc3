from readygo.services.reconstructor.frames.panorama import view_rotations
from readygo.services.reconstructor.poses.pairs import image_pairs, view_pairs


def test_photos_are_compared_each_with_each() -> None:
    assert image_pairs(4, sequential=False, overlap=2) == [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]


def test_frames_are_compared_with_neighbours_and_across_the_video() -> None:
    pairs = image_pairs(300, sequential=True, overlap=10)
    assert {(7, 7 + step) for step in (*range(1, 11), 20, 40, 80, 160)} <= set(pairs)
    assert (0, 296) in pairs
    assert len(pairs) == len(set(pairs)) < 0.15 * 300 * 299 / 2
    assert all(a < b < 300 for a, b in pairs)


def test_views_are_compared_with_similar_ones_nearby_and_with_all_of_their_ring_far_away() -> None:
    rig = view_rotations()
    near, far = view_pairs(rig, near=True), view_pairs(rig, near=False)
    assert len(near) == 8 * 3
    assert {("view_0", "view_0"), ("view_0", "view_4"), ("view_0", "view_7"), ("view_4", "view_0")} <= set(near)
    assert len(far) == 2 * 4 * 4
    assert ("view_0", "view_2") in far
    assert ("view_0", "view_4") not in far
