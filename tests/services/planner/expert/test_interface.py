from types import SimpleNamespace

import numpy as np

from readygo.services.planner.expert.interface import ExpertDriver, expected_array
from tests.services.planner.runs import perceived


def test_driver_asks_the_expert_of_each_episode():
    experts = {name: SimpleNamespace(act=lambda s, v=v: SimpleNamespace(v_mps=v, w_radps=0.5 + s.step)) for name, v in
               (("a", 1.0), ("b", 2.0))}  # fmt: skip
    driver = ExpertDriver(lambda scenario, motions: experts[scenario])
    simulations = [SimpleNamespace(scenario=name, motions=None, step=k) for k, name in enumerate("ab")]
    states = [driver.start(simulation) for simulation in simulations]
    assert states == [experts["a"], experts["b"]]
    assert driver.act(list(zip(simulations, states, strict=True))) == [(1.0, 0.5), (2.0, 1.5)]
    assert not driver.looks


def test_humans_are_rows_of_what_is_ahead_of_them():
    expected = expected_array([perceived(1.0, 2.0), perceived(-3.0, 0.0)], 5)
    assert expected.shape == (2, 5, 2)
    assert np.array_equal(expected[1], perceived(-3.0, 0.0).ahead_m[:5])
    assert expected[:, :, 0].tolist() == [[1.0] * 5, [-3.0] * 5]
    assert expected_array([], 5).shape == (0, 5, 2)
