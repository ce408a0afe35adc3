import json
from pathlib import Path

import numpy as np

from readygo.benchmarks.motion import gait_curves as source
from readygo.services.animator.gait import curves as gait_curves


def test_file_of_the_curves_is_what_the_script_derives(mocap):
    stored = json.loads(Path(gait_curves.__file__).with_name("curves.json").read_text())["clips"]
    assert list(stored) == [*source.WALKS, *source.RUNS]
    for name, clip in stored.items():
        derived = source.derive(mocap, name)
        assert derived.keys() == clip.keys()
        for key, value in derived.items():
            assert np.abs(np.asarray(value, dtype=float) - np.asarray(clip[key], dtype=float)).max() <= 2e-4, key
