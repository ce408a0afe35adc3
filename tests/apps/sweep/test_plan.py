from pathlib import Path

import pytest

from readygo.apps.sweep.plan import open_sweep, scene_name
from readygo.common.errors import ConfigError
from tests.apps.sweep.sweeps import EVALUATE, read_sweep, write_sweep


def test_points_are_arms_then_scenes_then_seeds(tmp_path: Path) -> None:
    points = read_sweep(tmp_path).points
    assert [point.name for point in points] == [
        "calm/embedded/0", "calm/embedded/1", "calm/embedded-1/0", "calm/embedded-1/1",
        "paper/embedded/0", "paper/embedded/1", "paper/embedded-1/0", "paper/embedded-1/1",
    ]  # fmt: skip
    assert [point.index for point in points] == list(range(8))


def test_arguments_are_those_of_the_command_line(tmp_path: Path) -> None:
    sweep = read_sweep(tmp_path)
    words = "evaluate embedded:1 --seed 1 --episodes 3 --methods straight-line expert --human-planner.yielding 1.0"
    assert sweep.arguments(sweep.points[3], Path("o")) == [*words.split(), "--out", "o", "--json"]
    options = sweep.read(sweep.points[3])
    assert (options.scene, options.trials.seed, options.methods) == ("embedded:1", 1, ("straight-line", "expert"))
    assert options.keys["human_planner"]["yielding"] == 1.0


def test_arm_overrides_the_options_of_all(tmp_path: Path) -> None:
    text = 'command = "rl"\nscenes = ["embedded"]\n[options]\nnoise = "exact"\n[arms.a]\n[arms.b]\nnoise = "perceived"'
    assert [point.words[-1] for point in read_sweep(tmp_path, text).points] == ["exact", "perceived"]


def test_own_names_stand_in_texts(tmp_path: Path) -> None:
    text = """
        command = "train"
        scenes = ["embedded:1"]
        seeds = [4]
        [arms.wide]
        data = ["data/{arm}/{scene}/{seed}", "more"]
    """
    assert read_sweep(tmp_path, text).points[0].words == ("data/wide/embedded-1/4", "more", "--seed", "4")


def test_benchmark_has_no_scenes_and_names_its_seeds_in_the_drivers(tmp_path: Path) -> None:
    text = """
        command = "benchmark run"
        seeds = [0, 1]
        options = {suite = "pedestrian-nav/1", drivers = ["mine/{seed}"], episodes = 2}
    """
    sweep = read_sweep(tmp_path, text)
    assert [point.name for point in sweep.points] == ["base/0", "base/1"]
    assert sweep.arguments(sweep.points[1], Path("o")) == [
        "benchmark", "run", "pedestrian-nav/1", "mine/1", "--episodes", "2", "--out", "o",
    ]  # fmt: skip


def test_given_seed_and_scene_stay_and_switches_are_words(tmp_path: Path) -> None:
    text = """
        command = "generate"
        seeds = [3, 4]
        options = {scene = "embedded", seed = 0, static = true, strict = false, policy = "p/{seed}"}
    """
    words = read_sweep(tmp_path, text).points[0].words
    assert words == ("embedded", "--seed", "0", "--static", "--policy", "p/3")


def test_table_is_of_keys_where_an_option_has_its_name(tmp_path: Path) -> None:
    text = 'command = "generate"\nscenes = ["embedded"]\n[options.robot.camera]\nwidth_px = 64'
    assert read_sweep(tmp_path, text).points[0].words[-2:] == ("--robot.camera.width_px", "64")


def test_several_scenes_are_one_point_in_an_inner_array(tmp_path: Path) -> None:
    text = 'command = "learn"\nscenes = ["embedded", ["embedded", "my/lobby hall"]]'
    points = read_sweep(tmp_path, text).points
    assert [point.scene for point in points] == ["embedded", "embedded+lobby-hall"]
    assert points[1].words[:2] == ("embedded", "my/lobby hall")
    assert scene_name("a/b:c") == "b-c"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("seeds = [0]", "name a command"),
        ('command = "drive"', "'drive' cannot be swept; a sweep runs generate, learn"),
        ('command = "rl"', "rl needs a scene"),
        ('command = "rl"\nscenes = ["embedded"]\narms = {}', "at least one arm"),
        ('command = "rl"\nscenes = ["embedded"]\nseeds = [1, 1]', "two seeds are named 1"),
        ('command = "rl"\nscenes = ["a/x", "b/x"]', "two scenes are named x"),
        ('command = "rl"\nscenes = ["embedded"]\n[arms."a b"]', "'a b' is no name"),
        ('command = "rl"\nscenes = ["scenes/.."]', "'..' is no name"),
        ('command = "rl"\nscenes = ["embedded"]\n[arms.a]\nout = "x"', "the option out is none of a sweep's"),
        ('command = "rl"\nscenes = ["embedded"]\n[arms.a]\nnois = "exact"', "arm a: unknown option '--nois'"),
        ('command = "rl"\nscenes = ["embedded"]\n[arms.a]\nnoise = "loud"', "arm a: --noise must be exact or"),
        (
            'command = "rl"\nscenes = ["embedded"]\n[arms.a]\n[arms.b]',
            "a/embedded/0 and b/embedded/0 are the same call",
        ),
        (
            'command = "evaluate"\nscenes = ["embedded"]\n[options]\nlockstep = true',
            "--lockstep must be a whole number",
        ),
        ('command = "generate"\nscenes = ["embedded"]\n[options]\nstatic = "x"', "static must be true or false"),
        ('command = "rl"\nseeds = "x"', "seeds must be an array"),
        ('command = "rl"\narm = {}', "Unknown key 'arm'"),
        ("command =", "Sweep"),
    ],
)
def test_wrong_file_is_one_line(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(ConfigError) as error:
        read_sweep(tmp_path, text)
    assert words in str(error.value)
    assert "\n" not in str(error.value)
    assert "SweepFile" not in str(error.value)


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nothing\.toml cannot be read: No such file"):
        open_sweep(tmp_path / "nothing.toml")


def test_too_many_points_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="has 12000 points, more than 10000"):
        read_sweep(tmp_path, EVALUATE.replace("[0, 1]", str(list(range(3000)))))


def test_hash_is_that_of_the_file(tmp_path: Path) -> None:
    path = write_sweep(tmp_path)
    before = open_sweep(path).sha256
    path.write_text(path.read_text() + "\n")
    assert open_sweep(path).sha256 != before
