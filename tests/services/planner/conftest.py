import pytest

from tests.services.planner.worlds import make_planner


@pytest.fixture(scope="package")
def planner():
    return make_planner()
