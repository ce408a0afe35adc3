import pytest

from tests.services.planner.worlds import make_robot_planner


@pytest.fixture(scope="module")
def paper_planner():
    return make_robot_planner(mode="paper")
