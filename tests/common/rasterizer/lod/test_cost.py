"""What a merger costs."""

from tests.common.rasterizer.lod.merging import merged_count, originals


def test_different_colours_merge_later() -> None:
    means = [(0.01 * k, 0.0, 0.0) for k in range(6)]
    same = originals(means, 0.8)
    striped = originals(means, 0.8, [0.0, 1.0] * 3)
    assert merged_count(same, 0.01, 0.02) < merged_count(striped, 0.01, 0.02)
