"""Which images are compared with each other."""

_FAR = 40
"""So many images, spread over a video, are compared each with each, so that ways that meet again are found."""


def image_pairs(count: int, *, sequential: bool, overlap: int) -> list[tuple[int, int]]:
    """Pairs (i, j), i < j, of images by their order.

    Photos are compared each with each. An image of a video is compared with the `overlap` images after it, with those
    2, 4, 8, ... times as far as that, and one of every few with all others of these.
    """
    if not sequential:
        return [(i, j) for i in range(count) for j in range(i + 1, count)]
    reach = [overlap * 2**power for power in range(1, 5)]
    pairs = {(i, i + step) for step in (*range(1, overlap + 1), *reach) for i in range(count - step)}
    every = max(1, -(-count // _FAR))
    pairs |= {(i, j) for i in range(0, count, every) for j in range(i + every, count, every)}
    return sorted(pairs)
