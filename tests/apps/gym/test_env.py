import subprocess
import sys

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="gymnasium (extra gym) is not installed")


@pytest.mark.filterwarnings("ignore:.*For Box action spaces.*")
def test_environment_passes_gymnasiums_checker():
    from gymnasium.utils.env_checker import check_env

    from readygo.apps.gym.env import PointNavEnv

    env = PointNavEnv(humans=1, image_px=(24, 32), render_mode="rgb_array")
    check_env(env, skip_render_check=True)
    observation, info = env.reset(seed=3)
    assert np.array_equal(env.render(), observation["rgb"])
    assert (info["cost_collision"], info["success"]) == (0.0, False)
    second, other = env.reset()
    assert other["episode"] != info["episode"]
    assert not np.array_equal(second["goal"], observation["goal"])


def test_pictures_come_as_often_as_the_robots_steps(tmp_path):
    from readygo.apps.gym.env import PointNavEnv
    from readygo.apps.gym.vector import PointNavVectorEnv

    config = tmp_path / "run.toml"
    config.write_text("[robot]\ncontrol_hz = 30\ncamera_hz = 10\n[robot.camera]\nheight_px = 24\nwidth_px = 32\n")
    assert PointNavEnv(humans=0, config=config).metadata["render_fps"] == 30
    assert PointNavVectorEnv(humans=0, config=config).metadata["render_fps"] == 30
    assert PointNavEnv.metadata["render_fps"] == 20


@pytest.mark.parametrize("imports", ["gymnasium", "gymnasium, readygo", "readygo, gymnasium"])
@pytest.mark.parametrize("prefix", ["readygo", "readygo.gym"])
def test_both_environments_are_found_by_their_module_in_a_fresh_process(prefix: str, imports: str):
    code = f"""
import {imports}
for name in ("PointNav", "StateNav"):
    try:
        gymnasium.make("{prefix}:ReadyGo/" + name + "-v0", scene="nowhere")
    except Exception as error:
        print(type(error).__name__)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["SceneError", "SceneError"], done.stderr


def test_readygo_loads_no_gymnasium_by_itself():
    code = "import readygo, sys; print('gymnasium' in sys.modules, 'numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "False"]
