import itertools

from readygo.common.episode import Purpose, episode_rng
from readygo.common.messages import EpisodeKey, Split


def _draw(seed: int, split: Split, index: int, purpose: Purpose) -> bytes:
    return episode_rng(EpisodeKey(seed=seed, split=split, index=index), purpose).bytes(64)


def test_no_two_streams_share_a_beginning() -> None:
    keys = list(itertools.product((0, 1), Split, range(50), Purpose))
    assert len({_draw(*key) for key in keys}) == len(keys)


def test_train_val_and_test_never_share_an_episode() -> None:
    draws = {split: {_draw(3, split, index, Purpose.SCENARIO) for index in range(500)} for split in Split}
    for a, b in itertools.combinations(Split, 2):
        assert not draws[a] & draws[b]


def test_stream_does_not_depend_on_what_was_drawn_before() -> None:
    first = _draw(1, Split.TEST, 9, Purpose.MOTION)
    _draw(1, Split.TEST, 8, Purpose.MOTION)
    assert _draw(1, Split.TEST, 9, Purpose.MOTION) == first
