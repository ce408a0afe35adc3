import hashlib
from pathlib import Path

import pytest

from readygo.common.errors import ConfigError, ReadygoError
from readygo.runs.benchmark.suite import PEDESTRIAN_NAV, open_suite, parse_suite
from readygo.services.evaluator import Task
from tests.runs.benchmark.suites import small_suite, suite_text


def test_published_suite_is_frozen():
    """A change is another version: results of the same name would not compare."""
    suite = open_suite(PEDESTRIAN_NAV)
    assert suite.sha256 == "7f93a3b99d9c6914e82694c89f1a2135389dc6ca3fb316fa6c7341333c4d1fdd"
    assert suite.suite.name == PEDESTRIAN_NAV
    assert [suite.episodes_of(scene) for scene in suite.suite.scenes] == [50, 50]


def test_cells_of_the_published_suite_differ_in_who_is_there_and_who_yields():
    suite = open_suite(PEDESTRIAN_NAV)
    people = {cell: suite.config(cell) for cell in suite.suite.cells}
    assert people["obstacles"].episode.human_count_max == 0
    assert people["obstacles"].human_planner.standing_min == 1
    for behaviour, task, yielding in (
        ("ignore", "dynamic", 1.0),
        ("react", "reactive", 0.2),
        ("yield", "reactive", 1.0),
    ):
        for cell in (f"pedestrians-{behaviour}", f"both-{behaviour}"):
            assert suite.suite.cells[cell].task == task
            assert people[cell].human_planner.yielding == yielding
            assert people[cell].episode == people["pedestrians-ignore"].episode
            assert (people[cell].human_planner.standing_max > 0) == cell.startswith("both")
    assert people["meeting-ignore"].episode.human_speed_max_mps == 1.4


def test_world_has_the_scene_people_and_settings_of_a_cell(tmp_path: Path):
    suite = small_suite(tmp_path)
    world = suite.world("people", "flat")
    assert world.scene.content_hash == suite.suite.scenes["flat"].sha256
    assert world.config.human_planner.yielding == 0.5
    assert world.config.episode.time_limit_s == suite.config("empty").episode.time_limit_s == 8.0
    request = suite.request("people", "flat", ("expert",))
    assert (request.tasks, request.episodes, request.seed) == ((Task.REACTIVE,), 4, 3)
    assert suite.sha256 == hashlib.sha256((tmp_path / "small.toml").read_bytes()).hexdigest()


def test_odd_numbers_of_episodes_are_spread_over_the_scenes():
    suite = open_suite(PEDESTRIAN_NAV)
    assert [suite.episodes_of(scene, 5) for scene in suite.suite.scenes] == [3, 2]


def test_another_scene_and_other_people_are_refused_by_their_hashes(tmp_path: Path):
    other = small_suite(tmp_path / "scene", **{'scene = "embedded"': 'scene = "embedded:1"'})
    with pytest.raises(
        ReadygoError, match=r"Scene flat of the suite small/1 has the hash \w{12}\.\.\., but embedded:1 "
    ):
        other.world("empty", "flat")
    people = small_suite(tmp_path / "people", **{'paper_cell = "people"': 'paper_cell = "people"\npeople_sha256 = {}'})
    assert people.world("empty", "flat").avatars
    strange = 'paper_cell = "people"\npeople_sha256 = { amara = "ab" }'
    changed = small_suite(tmp_path / "changed", **{'paper_cell = "people"': strange})
    with pytest.raises(ConfigError, match="people of the suite small/1 are others here: avatar 'amara' differs"):
        changed.world("empty", "flat")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('paper_cell = "people"', 'paper_cell = "nobody"', "paper_cell 'nobody' is none of its cells"),
        ("episodes = 4", "episodes = 0", "at least one episode"),
        ("[scenes.flat]", '[scenes."../flat"]', "'../flat' is no name"),
        ('task = "static"', 'task = "slow"', "must be one of"),
        ("readygo-suite/1", "readygo-suite/2", "format must be one of"),
        ("seed = 3", "seed = 3\nwhen = 1", "Unknown key"),
        ("seed = 3", "seed = ", "Suite mine"),
        ("seed = 3", "", r"Suite mine: Key seed of scenes\.flat must be given\."),
    ],
)
def test_what_is_wrong_with_a_file_is_one_line(old: str, new: str, said: str):
    with pytest.raises(ConfigError, match=said) as caught:
        parse_suite(suite_text(**{old: new}).encode(), "mine", Path())
    assert "\n" not in str(caught.value)


def test_wrong_setting_is_named_with_suite_and_cell_before_anything_is_driven(tmp_path: Path):
    with pytest.raises(ConfigError, match=r"Suite small/1, cell people: .*yielding must be 0\.\.1"):
        small_suite(tmp_path, **{"yielding = 0.5": "yielding = 2.0"})


def test_file_with_a_byte_order_mark_is_read():
    assert parse_suite(b"\xef\xbb\xbf" + suite_text().encode(), "mine", Path()).suite.name == "small/1"


def test_unknown_suites_are_refused_with_those_that_there_are(tmp_path: Path):
    with pytest.raises(ConfigError, match=r"no suite 'walks/1'; there are pedestrian-nav/1, and yours as a \.toml"):
        open_suite("walks/1")
    with pytest.raises(ConfigError, match="cannot be read"):
        open_suite(str(tmp_path / "none.toml"))
