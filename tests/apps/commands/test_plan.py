"""`readygo plan`: an episode in numbers, pictures and films; mistakes in one line."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.apps.commands.plan import PlanEpisodeOptions, PlanOptions, _check, _check_endings, _rows, plan
from readygo.common.errors import ConfigError, ReadygoError, RunError, SceneError
from readygo.common.maps import save_ros_map
from readygo.runs.options import WorldOptions
from readygo.services.planner.humans.scenario_file import load_scenarios
from tests.services.planner.worlds import rooms

SEED = 3


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The four rooms as a ROS map."""
    path = tmp_path_factory.mktemp("map") / "rooms.yaml"
    save_ros_map(rooms(), path)
    return str(path)


@pytest.fixture(scope="module")
def index(place: str) -> int:
    """The first index that has a scenario."""
    for number in range(20):
        try:
            plan(PlanOptions(scene=place, seed=SEED, index=number, keys={"expert": {"mode": "paper"}}, json=True))
        except RunError:
            continue
        return number
    raise AssertionError("no index has a scenario")


def numbers_of(capsys: pytest.CaptureFixture[str], place: str, **options) -> dict:
    capsys.readouterr()
    plan(PlanOptions(scene=place, seed=SEED, json=True, **options))
    return json.loads(capsys.readouterr().out)


def test_numbers_tell_the_robots_and_every_humans_story(place, index, capsys) -> None:
    numbers = numbers_of(capsys, place, index=index, keys={"expert": {"mode": "paper"}})
    assert numbers["episode"] == f"train-{SEED}-{index:06d}"
    assert numbers["mode"] == "paper"
    assert numbers["outcome"] in {"success", "human_collision", "static_collision", "timeout"}
    assert numbers["rejected"] == ("" if numbers["outcome"] == "success" else numbers["outcome"])
    assert 0 < numbers["replan_p50_ms"] <= numbers["replan_p99_ms"]
    assert numbers["paths"] <= numbers["replans"]
    closest = min(human["closest_m"] for human in numbers["humans"])
    assert closest == pytest.approx(numbers["human_distance_min_m"], abs=2e-3)
    for human in numbers["humans"]:
        assert set(human) == {"avatar", "encounter", "speed_mps", "closest_m", "closest_s", "visible_s"}
        assert all(0 <= begin < end <= numbers["duration_s"] for begin, end in human["visible_s"])


def test_same_episode_gives_the_same_picture(place, index, tmp_path, capsys) -> None:
    for name in ("a", "b"):
        plan(
            PlanOptions(
                scene=place,
                seed=SEED,
                index=index,
                keys={"expert": {"mode": "paper"}},
                picture=tmp_path / name / "p.png",
            )
        )
    assert (tmp_path / "a" / "p.png").read_bytes() == (tmp_path / "b" / "p.png").read_bytes()
    assert cv2.imread(str(tmp_path / "a" / "p.png")).shape[1] > 600
    assert "p.png" in capsys.readouterr().out


def test_static_episode_has_the_dynamic_ones_start_and_goal(place, index, capsys) -> None:
    dynamic = numbers_of(capsys, place, index=index, keys={"expert": {"mode": "paper"}})
    static = numbers_of(
        capsys, place, index=index, keys={"expert": {"mode": "paper"}}, episode=PlanEpisodeOptions(static=True)
    )
    assert static["humans"] == []
    assert static["human_distance_min_m"] is None
    assert (static["start_xyyaw"], static["goal_xy_m"]) == (dynamic["start_xyyaw"], dynamic["goal_xy_m"])


def test_film_shows_every_step_in_real_time(place, index, tmp_path, capsys) -> None:
    numbers = numbers_of(
        capsys,
        place,
        index=index,
        keys={"expert": {"mode": "paper"}},
        episode=PlanEpisodeOptions(static=True),
        video=tmp_path / "v.webm",
    )
    film = cv2.VideoCapture(str(tmp_path / "v.webm"))
    assert film.get(cv2.CAP_PROP_FPS) == pytest.approx(20.0)
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) == round(numbers["duration_s"] * 20)
    _, first = film.read()
    film.set(cv2.CAP_PROP_POS_FRAMES, round(numbers["duration_s"] * 20) - 1)
    _, last = film.read()
    assert np.abs(first.astype(int) - last).max() > 50


def test_exported_scenario_can_be_read_again(place, index, tmp_path, capsys) -> None:
    numbers = numbers_of(capsys, place, index=index, keys={"expert": {"mode": "paper"}}, export=tmp_path / "s.toml")
    (scripted,) = load_scenarios(tmp_path / "s.toml").entries
    assert [round(value, 4) for value in scripted.goal_m] == numbers["goal_xy_m"]
    assert [human.avatar for human in scripted.humans] == [human["avatar"] for human in numbers["humans"]]


def test_modes_drive_differently(place, index, capsys) -> None:
    assert numbers_of(capsys, place, index=index)["mode"] == "spacetime"
    with pytest.raises(ConfigError, match="mode must be one of"):
        plan(PlanOptions(scene=place, seed=SEED, index=index, keys={"expert": {"mode": "telepathy"}}))


def test_index_without_a_scenario_is_an_error_that_says_why(place, index, tmp_path) -> None:
    config = tmp_path / "crowded.toml"
    config.write_text('[human_planner]\neffort = "quick"\n[episode]\nhuman_radius_m = 3.0\n')
    with pytest.raises(RunError, match=r"has no scenario: no room for a human\. Ask for another --index"):
        plan(PlanOptions(scene=place, seed=SEED, index=index, config=config, picture=tmp_path / "p.png"))
    assert not (tmp_path / "p.png").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"index": -1}, "--index must be at least 0"),
        ({"picture": Path("p.jpg")}, r"--picture p\.jpg must end in \.png"),
        ({"video": Path("v.avi")}, r"--video v\.avi must end in \.webm or \.mp4"),
        ({"export": Path("s.json")}, r"--export s\.json must end in \.toml"),
        ({"episode": PlanEpisodeOptions(camera=True)}, r"is a map"),
        ({"policy": Path("policy")}, "is a map"),
    ],
)
def test_arguments_that_make_no_sense_are_refused(place, options, message) -> None:
    with pytest.raises(RunError, match=message):
        plan(PlanOptions(scene=place, seed=SEED, **options))


def test_camera_is_shown_somewhere() -> None:
    with pytest.raises(RunError, match=r"say where with --picture FILE\.png or --video"):
        plan(PlanOptions(scene="embedded", episode=PlanEpisodeOptions(camera=True)))


def test_people_scenarios_and_sensor_are_those_of_generate(place, index, tmp_path, capsys) -> None:
    crowd = numbers_of(capsys, place, index=index, people="crowd", export=tmp_path / "s.toml")
    played = numbers_of(
        capsys, place, index=7, world=WorldOptions(scenarios=tmp_path / "s.toml", sensor="sensor_phone_like")
    )
    assert played["episode"].endswith("000007")
    assert played["start_xyyaw"] == pytest.approx(crowd["start_xyyaw"], abs=1e-3)
    assert [human["avatar"] for human in played["humans"]] == [human["avatar"] for human in crowd["humans"]]


def test_scene_that_is_none_is_refused(tmp_path) -> None:
    for name in (str(tmp_path / "no.yaml"), str(tmp_path / "nowhere")):
        with pytest.raises(SceneError):
            plan(PlanOptions(scene=name))


def test_picture_that_cannot_be_written_is_one_line(place, index, tmp_path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(ReadygoError, match="cannot be written"):
        plan(
            PlanOptions(
                scene=place,
                seed=SEED,
                index=index,
                keys={"expert": {"mode": "paper"}},
                picture=tmp_path / "file" / "p.png",
            )
        )


def test_rows_tell_the_same_as_the_numbers() -> None:
    human = {"avatar": "ann", "encounter": "crossing", "speed_mps": 1.236}
    met = human | {"closest_m": 0.456, "closest_s": 3.216, "visible_s": [(1.0, 2.5), (4.0, 4.05)]}
    unseen = met | {"visible_s": []}
    drawn = {"goal_distance_m": 7.126, "humans": [human], "rejected": "no_path"}
    assert _rows(drawn) == [
        ("goal", "7.13 m away"), ("pedestrian 1", "ann, crossing, 1.24 m/s"), ("recorded by generate", "no: no path")
    ]  # fmt: skip
    driven = {
        **drawn, "outcome": "human_collision", "duration_s": 12.35, "path_length_m": 8.761,
        "replans": 7, "paths": 3, "replan_p50_ms": 1.236, "replan_p99_ms": 9.876, "humans": [met, unseen],
        "rejected": "", "human_visible_share": 0.376,
    }  # fmt: skip
    closest = "closest 0.46 m at 3.22 s; in view"
    assert _rows(driven) == [
        ("outcome", "human collision after 12.35 s"),
        ("goal", "7.13 m away"),
        ("path", "8.76 m"),
        ("replans", "7, 3 different paths; p50 1.24 ms, p99 9.88 ms"),
        ("a pedestrian in view", "38 % of the time"),
        ("pedestrian 1", f"ann, crossing, 1.24 m/s; {closest} 1.00-2.50 s, 4.00-4.05 s"),
        ("pedestrian 2", f"ann, crossing, 1.24 m/s; {closest} never"),
        ("recorded by generate", "yes"),
    ]
    alone = {key: value for key, value in driven.items() if key != "rejected"} | {"humans": [], "replans": 0}
    assert [row for row in _rows(alone) if row[0] in ("replans", "a pedestrian in view", "recorded by generate")] == [
        ("replans", "0, 3 different paths")
    ]


def test_largest_and_smallest_arguments_are_taken() -> None:
    _check("embedded", 0, 2**63 - 1, camera=True)
    _check("map.yaml", 3, 0, camera=False)
    _check_endings(Path("a.PNG"), Path("b.MP4"), Path("c.toml"))
    _check_endings(None, Path("b.webm"), None)
    for seed in (-1, 2**63):
        with pytest.raises(RunError, match="--seed 0"):
            _check("embedded", 0, seed, camera=False)
    for name in ("map.yaml", "map.yml"):
        with pytest.raises(RunError, match="is a map"):
            _check(name, 0, 0, camera=True)
