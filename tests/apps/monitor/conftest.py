import pytest

from readygo.common.messages import RunSpec, Split


@pytest.fixture
def spec() -> RunSpec:
    """A run whose scene is not on this machine."""
    return RunSpec(
        run="run-a",
        scene_path="/nowhere",
        scene_hash="",
        scene_files=(),
        avatars_path="",
        avatar_hashes={},
        seed=7,
        split=Split.TRAIN,
        static=False,
        config={},
        metadata={},
    )
