import pytest

gymnasium = pytest.importorskip("gymnasium", reason="gymnasium (extra gym) is not installed")


def test_registered_once_however_often_it_is_asked_for():
    from readygo.apps.gym.registration import ENVIRONMENT, register

    register()
    register()
    assert gymnasium.spec(ENVIRONMENT).vector_entry_point == "readygo.apps.gym.vector:PointNavVectorEnv"
