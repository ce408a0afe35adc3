from collections import Counter

from readygo.services.trainer.reservoir import Reservoir
from tests.services.trainer.conftest import make_one

SIZE = make_one("x").size_bytes


def filled(names, room, seed=0, policy=lambda name: ""):
    reservoir = Reservoir(int(room * SIZE), seed)
    for name in names:
        reservoir.add(make_one(name, policy=policy(name)))
    return reservoir


def test_size_stays_within_the_limit_whatever_comes():
    reservoir = filled([f"e{k}" for k in range(50)], 10.5)
    assert len(reservoir.episodes) == 10
    assert reservoir.size_bytes == sum(e.size_bytes for e in reservoir.episodes.values()) <= 10.5 * SIZE


def test_what_is_kept_is_a_function_of_the_seed():
    names = [f"e{k}" for k in range(50)]
    kept = set(filled(names, 10).episodes)
    assert set(filled(names, 10).episodes) == kept
    assert set(filled(names[::-1], 10).episodes) == kept
    assert set(filled(names, 10, seed=1).episodes) != kept


def test_every_episode_of_a_round_is_as_likely_to_stay():
    kept = Counter(name for seed in range(60) for name in filled([f"e{k}" for k in range(20)], 10, seed).episodes)
    early = sum(kept[f"e{k}"] for k in range(10))
    assert 0.4 < early / sum(kept.values()) < 0.6


def test_no_round_crowds_out_another_one():
    names = [f"{policy}{k}" for policy, count in (("a", 4), ("b", 40), ("c", 40)) for k in range(count)]
    rounds = Counter(name[0] for name in filled(names, 24, policy=lambda name: name[0]).episodes)
    assert rounds["a"] == 4
    assert min(rounds["b"], rounds["c"]) >= 9


def test_episode_that_is_there_is_not_taken_twice():
    reservoir = filled(["a", "a"], 10)
    assert list(reservoir.episodes) == ["a"]
    assert reservoir.version == 1


def test_single_episode_stays_though_it_is_too_large():
    assert list(filled(["a"], 0.5).episodes) == ["a"]


def test_what_leaves_is_forgotten_in_the_sizes_of_its_round():
    reservoir = filled([f"{policy}{k}" for k in range(30) for policy in "ab"], 8.5, policy=lambda name: name[0])
    kept = Counter(name[0] for name in reservoir.episodes)
    assert kept["a"] == kept["b"] == 4
    version = reservoir.version
    reservoir.add(make_one("new", policy="c"))
    assert Counter(name[0] for name in reservoir.episodes)["n"] == 1
    assert len(reservoir.episodes) == 8
    assert reservoir.version == version + 2
    assert reservoir.size_bytes == sum(episode.size_bytes for episode in reservoir.episodes.values())


def test_as_many_stay_as_fit_to_the_byte():
    assert len(filled(["a", "b", "c"], 3).episodes) == 3
    assert len(filled(["a", "b", "c"], 3 - 1 / SIZE).episodes) == 2


def test_episode_without_samples_is_not_taken():
    reservoir = Reservoir(10 * SIZE)
    reservoir.add(make_one("empty", samples=0))
    assert (len(reservoir.episodes), reservoir.version) == (0, 0)
