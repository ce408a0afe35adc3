import pytest

from tests.services.planner.worlds import make_human_planner, make_robot_planner


@pytest.fixture(scope="package")
def human_planner():
    return make_human_planner()


@pytest.fixture(scope="package")
def robot_planner():
    return make_robot_planner()
