"""Our PPO beside that of stable-baselines3: the same robots, episodes, observations, rewards and decisions.

    python -m experiments.policy.reinforcement_peer --decisions 2097152

Differences: the peer's critic is told what the robot is told, ours the truth; the peer's weight of the entropy is
constant.
Prints a line of JSON per learner: success on split val, and decisions per second of processor time.
"""

import argparse
import json
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv

from readygo.apps.gym.state_nav import StateNavVectorEnv
from readygo.common.messages import Split
from readygo.common.state_policy.state_policy import StatePolicy, StatePolicySpec
from readygo.common.state_simulation.simulation import StateSimulation
from readygo.common.state_simulation.tracks import tracker_numbers
from readygo.runs.config import RunConfig
from readygo.runs.evaluation import evaluation_world
from readygo.runs.reinforcement import draw_bank, run_reinforcement
from readygo.runs.state_world import state_world
from readygo.services.trainer import ReinforcementConfig
from readygo.services.trainer.reinforcement.networks import layers_of
from readygo.services.trainer.reinforcement.run import TASKS, success_rate


class Robots(VecEnv):
    """`StateNavVectorEnv` for stable-baselines3."""

    def __init__(self, count: int, episodes: int, config: ReinforcementConfig) -> None:
        self._envs = StateNavVectorEnv(
            count,
            autoreset_mode=AutoresetMode.SAME_STEP,
            episodes=episodes,
            observation=config.observation,
            noise=config.noise,
            static_share=config.static_share,
        )
        super().__init__(count, self._envs.single_observation_space, self._envs.single_action_space)

    def reset(self) -> np.ndarray:
        """Begin an episode for every robot; returns its observations."""
        return self._envs.reset(seed=0)[0]

    def step_async(self, actions: np.ndarray) -> None:
        """Set the next commands."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Drive for one decision."""
        observation, rewards, terminated, truncated, infos = self._envs.step(self._actions)
        ended, told = terminated | truncated, [{} for _ in range(self.num_envs)]
        for k in np.flatnonzero(ended).tolist():
            told[k] = {"terminal_observation": infos["final_obs"][k], "TimeLimit.truncated": bool(truncated[k])}
        return observation, rewards, ended, told

    def close(self) -> None:
        """There is nothing to release."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of the environments, once for each robot."""
        return [getattr(self._envs, attr_name, None)] * self.num_envs

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Not supported: single robots have no attributes to set."""
        raise NotImplementedError

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **arguments: Any) -> list[Any]:
        """Not supported: single robots have no methods."""
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """False for every robot: single robots have no wrappers."""
        return [False] * self.num_envs


def main() -> None:
    """Train both and print their results."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--decisions", type=int, default=1 << 21)
    parser.add_argument("--episodes", type=int, default=2000)
    options = parser.parse_args()
    torch.set_num_threads(1)
    config = ReinforcementConfig(train_episodes=options.episodes, demonstrations=0)
    world = evaluation_world("embedded", RunConfig(), avatars=None, seed=0, split=Split.TRAIN)
    with TemporaryDirectory() as folder:
        ours = run_reinforcement([world], config, Path(folder), decisions=options.decisions, minutes=None)
    names = ("val_static", "val_dynamic", "decisions_per_s")
    print(json.dumps({"learner": "readygo", **{name: ours[name] for name in names}}))
    ppo, robots = config.ppo, Robots(config.ppo.robots, options.episodes, config)
    peer = PPO(
        "MlpPolicy",
        robots,
        n_steps=ppo.stretch,
        batch_size=ppo.robots * ppo.stretch // ppo.minibatches,
        n_epochs=ppo.epochs,
        learning_rate=lambda left: ppo.learning_rate * max(left, 0.05),
        gamma=ppo.gamma,
        gae_lambda=ppo.lam,
        clip_range=ppo.clip,
        ent_coef=(ppo.entropy_first + ppo.entropy_last) / 2,
        max_grad_norm=ppo.gradient_max,
        policy_kwargs={
            "net_arch": {"pi": list(ppo.actor_widths), "vf": list(ppo.critic_widths)},
            "activation_fn": torch.nn.ReLU,
        },
        seed=0,
        device="cpu",
    )
    began_s = time.process_time()
    peer.learn(options.decisions)
    spent_s = time.process_time() - began_s
    actor = torch.nn.Sequential(*peer.policy.mlp_extractor.policy_net, peer.policy.action_net)
    spec = StatePolicySpec(
        robot=world.config.robot, scenes={world.spec.scene_hash: world.scene.name}, noise=config.noise
    )
    policy = StatePolicy(spec=spec, layers=layers_of(actor))
    val = draw_bank(world, Split.VAL, config.val_episodes)
    numbers = tracker_numbers(config.noise, world.config.robot.clock)
    seen = StateSimulation(state_world(world, config.observation), val, numbers, len(val), knows_truth=False)
    rates = {f"val_{task}": success_rate(policy, seen, dynamic=dynamic) for task, dynamic in TASKS.items()}
    print(json.dumps({"learner": "stable-baselines3", **rates, "decisions_per_s": round(options.decisions / spent_s)}))


if __name__ == "__main__":
    main()
