import dataclasses

import pytest

from readygo.common.messages import RunSpec
from tests.common.messages.run_specs import SPEC


@pytest.fixture
def spec() -> RunSpec:
    """A run whose scene is not on this machine."""
    return dataclasses.replace(SPEC, run="run-a", scene_path="/nowhere", seed=7)
