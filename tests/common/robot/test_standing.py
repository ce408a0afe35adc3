import numpy as np

from readygo.common.robot.standing import STAND_M, Standing


def test_robots_stand_until_they_leave_their_place():
    standing, away = Standing(2), STAND_M + 0.01
    places = np.array([[1.0, 2.0], [3.0, 4.0]])
    assert standing.seconds(np.array([5.0, 0.0]), places).tolist() == [0.0, 0.0]
    assert standing.seconds(np.array([6.0, 2.0]), places + 0.6 * STAND_M).tolist() == [1.0, 2.0]
    places[1, 0] += away
    assert standing.seconds(np.array([7.0, 3.0]), places).tolist() == [2.0, 0.0]
    assert standing.seconds(np.array([8.0, 5.0]), places).tolist() == [3.0, 2.0]
