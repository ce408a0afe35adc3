from dataclasses import replace

from readygo.services.reconstructor.poses.verdict import disagreement, judge, refusal
from tests.services.reconstructor.synthetic import floor_points, mapped, ring, some_similarity

IMAGES = mapped(ring(), floor_points(), some_similarity())


def test_good_map_is_taken() -> None:
    verdict = judge(IMAGES, asked=14, components=(12,), sequential=True)
    assert (verdict.registered, verdict.points, verdict.points_per_image) == (12, 400, 400)
    assert abs(verdict.reprojection_px - 0.3) < 1e-9
    assert verdict.loops > 0
    assert verdict.weakest_link == 400
    assert refusal(verdict) is None


def test_way_that_never_meets_itself_is_said_to_drift() -> None:
    near = IMAGES.seen[IMAGES.seen[:, 0] // 3 == IMAGES.seen[:, 1] % 4]
    verdict = judge(replace(IMAGES, seen=near), asked=12, components=(12,), sequential=True)
    assert verdict.loops == 0
    assert verdict.weakest_link == 0
    assert verdict.drift.startswith("not held")


def test_bad_maps_are_refused_with_advice() -> None:
    good = judge(IMAGES, asked=12, components=(12,), sequential=True)
    for bad, words in [
        (replace(good, images=29, registered=2), "2 of 29 images found a pose; 60 % are needed"),
        (replace(good, images=20, components=(12, 6)), "pieces of 12 + 6 images"),
        (replace(good, reprojection_px=3.0), "off by 3.0 px"),
        (replace(good, points_per_image=9.0), "too little texture"),
    ]:
        reason = refusal(bad)
        assert reason is not None
        assert words in reason
        assert "Film again" in reason


def test_map_that_comes_out_the_same_again_is_believed() -> None:
    assert disagreement(IMAGES, IMAGES.transform(some_similarity())) is None
    fewer = replace(IMAGES, names=IMAGES.names[:10], T_world_camera=IMAGES.T_world_camera[:10])
    assert disagreement(IMAGES, fewer) is None


def test_map_that_comes_out_otherwise_is_not() -> None:
    bent = IMAGES.T_world_camera.copy()
    bent[:4, :3, 3] += 0.5
    half = replace(IMAGES, names=IMAGES.names[:6], T_world_camera=IMAGES.T_world_camera[:6])
    for other, words in [
        (None, "12 images, then 0"),
        (half, "12 images, then 6"),
        (replace(IMAGES, focal_px=0.7 * IMAGES.focal_px), "the focal length is 600 px, then 420 px"),
        (replace(IMAGES, T_world_camera=bent), "of the whole way apart"),
    ]:
        assert words in (disagreement(IMAGES, other) or "")
