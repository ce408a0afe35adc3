"""A run's spec for tests that need no scene."""

from readygo.common.messages import RunSpec, Split

SPEC = RunSpec(
    run="run-test",
    scene_path="scene",
    scene_hash="0" * 64,
    scene_files=(),
    avatars_path="",
    avatar_hashes={},
    seed=5,
    split=Split.TRAIN,
    static=False,
    config={},
    metadata={},
)
