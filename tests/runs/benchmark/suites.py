"""A small suite in the embedded flat: two cells, one scene, short episodes."""

from pathlib import Path

from readygo.runs.benchmark.suite import OpenSuite, open_suite
from readygo.runs.scene_argument import open_scene

TEXT = """
format = "readygo-suite/1"
name = "small/1"
episodes = 4
paper_cell = "people"

[scenes.flat]
scene = "embedded"
sha256 = "{sha256}"
seed = 3

[settings.episode]
goal_distance_max_m = 4.0
time_limit_s = 8.0

[cells.empty]
task = "static"
words = "nobody"

[cells.people]
task = "reactive"
words = "some stand, and every second who walks yields"

[cells.people.settings.human_planner]
yielding = 0.5
standing_min = 1
standing_max = 1
"""


def suite_text(**changes: str) -> str:
    """The suite's file, with some of its text replaced."""
    text = TEXT.format(sha256=open_scene("embedded").content_hash)
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    return text


def small_suite(folder: Path, **changes: str) -> OpenSuite:
    """The suite, of a file in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "small.toml").write_text(suite_text(**changes))
    return open_suite(str(folder / "small.toml"))
