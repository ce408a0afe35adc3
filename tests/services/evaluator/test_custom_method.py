"""Methods of users, who may do anything."""

import dataclasses
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from readygo.common.episode.loop import DriverFailure
from readygo.common.errors import RunError
from readygo.common.robot import RobotConfig
from readygo.services.evaluator.custom_method import CustomDriver, load_custom_method, stated_training

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "my_method.py"
EVALUATOR = SimpleNamespace(robot=RobotConfig(), eyes=lambda: None)


class Eyes:
    def look(self, simulations):
        return np.stack([np.full((2, 4, 3), round(simulation.time_s), np.uint8) for simulation in simulations])


@dataclasses.dataclass
class Simulation:
    time_s: float = 0.0
    goal_xy_robot_m: tuple = (2.0, 1.0)
    v_mps: float = 0.5
    w_radps: float = 0.0


class Method:
    """Does what its memory says."""

    def __init__(self, *answers):
        self.answers = list(answers)

    def start(self):
        return []

    def act(self, memory, observation):
        memory.append(observation)
        answer = self.answers[len(memory) - 1]
        return answer() if callable(answer) else answer


def commands(method, steps, **settings):
    driver, simulation = CustomDriver(method, Eyes(), **settings), Simulation()
    ride = driver.start(simulation)
    return [driver.act([(simulation, ride)])[0] for _ in range(steps)], ride


def test_method_is_given_what_the_robot_knows():
    driven, ride = commands(Method((0.5, 0.1), np.array([0.2, 0.3])), 2)
    assert driven == [(0.5, 0.1), (0.2, 0.3)]
    seen = ride.memory[0]
    assert (seen.goal_xy_m, seen.v_mps, seen.rgb.shape) == ((2.0, 1.0), 0.5, (2, 4, 3))


def raising():
    raise KeyError("no map")


@pytest.mark.parametrize(
    ("answer", "said"),
    [(raising, "KeyError: 'no map'"), (None, "it commanded None, not two numbers"), ((1, 2, 3), "not two numbers")],
)
def test_method_that_raises_or_answers_nonsense_fails_with_the_reason(answer, said):
    driven, _ = commands(Method(answer), 1)
    assert isinstance(driven[0], DriverFailure)
    assert said in driven[0].reason


def test_method_that_hangs_costs_its_time_limit_alone():
    driven, _ = commands(Method(lambda: time.sleep(3.0), (0.1, 0.0)), 2, limit_s=0.2)
    assert driven == [DriverFailure("it took longer than 0.2 s for a command"), (0.1, 0.0)]


def test_episode_whose_start_fails_has_failed():
    method = Method()
    method.start = raising
    driver = CustomDriver(method, Eyes())
    ride = driver.start(Simulation())
    assert isinstance(driver.act([(Simulation(), ride)])[0], DriverFailure)


def test_method_is_found_by_module_or_by_file():
    driver = load_custom_method(f"{EXAMPLE}:KeepsAway", EVALUATOR)
    assert isinstance(driver, CustomDriver)
    assert len(EXAMPLE.read_text().splitlines()) <= 40
    with pytest.raises(RunError, match=r"^The method collections:OrderedDict cannot be made of the robot: TypeError"):
        load_custom_method("collections:OrderedDict", EVALUATOR)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("no_such_package:Driver", "cannot be imported: ModuleNotFoundError"),
        ("json:Driver", "cannot be imported: AttributeError"),
        ("nowhere/my.py:Driver", "there is no file"),
        ("builtins:repr", r"has no start\(\)"),
    ],
)
def test_what_is_no_method_is_refused_in_a_line(name, said):
    with pytest.raises(RunError, match=said) as caught:
        load_custom_method(name, EVALUATOR)
    assert "\n" not in str(caught.value)


def test_class_states_what_it_has_learned_from_in_a_text_or_not_at_all(tmp_path: Path):
    (tmp_path / "mine.py").write_text(
        "class A: ...\nclass B:\n    trained_on = 'ten films'\nclass C:\n    trained_on = 3\n"
    )
    assert stated_training(f"{tmp_path / 'mine.py'}:A") is None
    assert stated_training(f"{tmp_path / 'mine.py'}:B") == "ten films"
    assert stated_training(f"{EXAMPLE}:KeepsAway") == ""
    with pytest.raises(RunError, match=r"trained_on of .*:C must be a text, got 3"):
        stated_training(f"{tmp_path / 'mine.py'}:C")
    with pytest.raises(RunError, match="cannot be imported: ImportError"):
        stated_training(f"{tmp_path / 'other.py'}:A")
