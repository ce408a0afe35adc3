import json

import pytest

from readygo.benchmarks.planning.maps import MapSource
from readygo.benchmarks.planning.plan import BenchPlanOptions, bench_plan, measure
from readygo.benchmarks.planning.runs import PlanningJob
from readygo.common.errors import ConfigError

JOB = PlanningJob(
    source=MapSource(name="embedded", path="embedded"),
    modes=("paper", "near_field"),
    tasks=("dynamic", "static"),
    seed=5,
)


def without_times(result):
    rows = [{k: v for k, v in row.items() if not k.endswith(("_ms", "_core_s"))} for row in result["rows"]]
    places = [{k: v for k, v in place.items() if not k.endswith("_ms")} for place in result["maps"]]
    return {**result, "rows": rows, "maps": places}


def test_numbers_do_not_depend_on_the_number_of_processes():
    one = measure([JOB], 2, process_count=1, quiet=True)
    two = measure([JOB], 2, process_count=2, quiet=True)
    assert without_times(one) == without_times(two)
    assert [(row["task"], row["mode"]) for row in one["rows"]] == [
        ("dynamic", "paper"),
        ("dynamic", "near_field"),
        ("static", "paper"),
        ("static", "near_field"),
    ]
    assert all(row["episode_count"] == 2 and row["expert_ms"] > 0 for row in one["rows"])


def test_run_on_the_embedded_scene_prints_a_line_per_mode(capsys):
    bench_plan(BenchPlanOptions(episodes=2, modes=("paper",), workers=1, seed=5))
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "2 test episodes per map, seed 5, people: paper"
    assert any(line.startswith("embedded: ") and "draws, rejected: " in line for line in lines)
    assert sum(line.startswith("paper ") for line in lines) == 2


def test_json_is_one_object_and_pictures_show_every_failure(capsys, tmp_path):
    bench_plan(
        BenchPlanOptions(episodes=3, modes=("paper",), tasks=("dynamic",), workers=1, json=True, pictures=tmp_path)
    )
    result = json.loads(capsys.readouterr().out)
    (row,) = result["rows"]
    failed = {path.parent.name: 0 for path in tmp_path.rglob("*.png")}
    for path in tmp_path.rglob("*.png"):
        failed[path.parent.name] += 1
    assert failed == {name.replace(", ", "_").replace(" ", "-"): n for name, n in row["failures"].items()}
    assert sum(failed.values()) == round(3 * (1 - row["success_rate"]))
    assert not list(tmp_path.rglob("*.partial"))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"episodes": 0}, "--episodes must be at least 1"),
        ({"workers": 0}, "--workers must be at least 1"),
        ({"seed": -1}, "--seed must not be negative"),
        ({"maps": ("nowhere",)}, "Unknown map 'nowhere'"),
        ({"maps": ()}, "--maps"),
    ],
)
def test_mistakes_are_one_line(options, message):
    with pytest.raises(ConfigError, match=message) as caught:
        bench_plan(BenchPlanOptions(**options))
    assert "\n" not in str(caught.value)


def test_data_folder_that_is_missing_is_named(tmp_path):
    with pytest.raises(ConfigError, match="is no folder"):
        bench_plan(BenchPlanOptions(data=tmp_path / "none"))
