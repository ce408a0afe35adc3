import dataclasses
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from readygo.apps.evaluation.replay import BEFORE_END_S, MAP_PX, Replays, strip_steps
from readygo.common.errors import RunError
from readygo.common.messages import Outcome
from readygo.common.perception import Perceived
from readygo.common.perception.grid import SHAPE
from readygo.common.perception.people import NOBODY
from readygo.common.policy import PolicyMemory
from readygo.common.robot.kinematics import STEP_NS
from readygo.runs.methods import PERCEIVE_AND_PLAN
from readygo.services.evaluator import POLICY, STRAIGHT_LINE, Task


def of(evaluated, method):
    records = [record for record in evaluated.reply.records if record.method == method]
    return evaluated.replays.load(records)


def test_episodes_are_driven_once_more_as_they_were(evaluated):
    for method in (POLICY, STRAIGHT_LINE):
        records = of(evaluated, method)
        assert len(records) == 4
        for record in records:
            trajectory = evaluated.replays.trajectory(record)
            assert trajectory.outcome is record.result.outcome
            assert trajectory.duration_s == pytest.approx(record.result.duration_s)


def test_map_and_strip_show_the_episode(evaluated):
    record = next(record for record in of(evaluated, POLICY) if record.task is Task.DYNAMIC)
    trajectory = evaluated.replays.trajectory(record)
    picture = evaluated.replays.draw(record, trajectory)
    assert picture.shape[1] <= MAP_PX[0] + 1
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 4
    strip = evaluated.replays.strip(record, trajectory)
    assert [image.time_s for image in strip] == sorted(image.time_s for image in strip)
    assert strip[0].rgb.shape == (8, 10, 3)
    assert not np.array_equal(strip[0].rgb, strip[-1].rgb)


def test_film_has_an_image_per_step(evaluated, tmp_path):
    record = of(evaluated, STRAIGHT_LINE)[0]
    evaluated.replays.film(tmp_path / "film.webm", record)
    film = cv2.VideoCapture(str(tmp_path / "film.webm"))
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) == round(record.result.duration_s * 20)


class Network:
    """Sees no one, and counts the images that it looks at."""

    def __init__(self):
        self.looks = 0

    def start(self):
        return PolicyMemory(4 * STEP_NS, frame_count=3)

    def perceive(self, memory, command):
        self.looks += 1
        count = SHAPE[1]
        return Perceived(people=NOBODY, rays_m=np.ones(count), rays_sd=np.ones(count), answers=np.zeros(0))


def test_network_of_a_driver_that_perceives_looks_at_the_replayed_images(evaluated):
    known, network = evaluated.replays, Network()
    renderer = known._renderer
    replays = Replays(
        known.world, known._results, evaluated.reply.episodes, renderer, known._simulate, perception=network
    )
    (record, *_) = replays.load([one for one in evaluated.reply.records if one.method == STRAIGHT_LINE])
    run = replays.run(record)
    assert replays.view(run).perceived is None, "this driver has no network"
    view = replays.view(dataclasses.replace(run, driver=PERCEIVE_AND_PLAN))
    view(9)
    assert network.looks == 5
    assert len(view.perceived.at(9).rays_m) == SHAPE[1]


def test_episode_that_goes_another_way_is_refused(evaluated):
    record = of(evaluated, POLICY)[0]
    longer = dataclasses.replace(record, result=dataclasses.replace(record.result, duration_s=9.0))
    with pytest.raises(RunError, match="goes differently now"):
        evaluated.replays.trajectory(longer)


def test_strip_of_a_collision_shows_its_last_seconds_and_another_all_of_it():
    def steps(outcome, count, rate_hz=20):
        return strip_steps(SimpleNamespace(outcome=outcome, xyyaw=range(count), rate_hz=rate_hz))

    assert steps(Outcome.HUMAN_COLLISION, 200) == [119, 139, 159, 179, 189, 199]
    assert steps(Outcome.HUMAN_COLLISION, 200, rate_hz=30)[0] == 79
    assert steps(Outcome.STATIC_COLLISION, 15) == [0, 4, 14]
    assert steps(Outcome.TIMEOUT, 1000)[::5] == [0, 999]
    assert len(steps(Outcome.TIMEOUT, 1000)) == len(BEFORE_END_S)
