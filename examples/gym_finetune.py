"""Fine-tune a policy by reinforcement learning, and compare success rates before and after on the same episodes.

    pip install -e ".[rl]" -c constraints.txt
    python examples/gym_finetune.py out/lobby-run/policy --scene out/lobby --minutes 10 --out out/finetuned
    readygo evaluate out/lobby out/finetuned

The policy comes from `readygo learn` or `readygo train` and imitates the expert. PPO of stable-baselines3 continues
from its weights in `ReadyGo/PointNav-v0`: the image encoder is frozen, the three layers behind it are trained. Commands
are drawn at random around the policy's output. The critic has the same inputs as the policy, and is trained alone
first.
"""

import argparse
import dataclasses
import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import make_vec, spaces
from gymnasium.vector import AutoresetMode
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv
from torch import nn

from readygo import ReadygoError, load_policy
from readygo.common.episode import EpisodeConfig
from readygo.common.errors import PolicyError
from readygo.common.messages import Split
from readygo.runs.evaluation import evaluation_world, make_evaluator, make_request
from readygo.runs.origin import avatars_of_policy, settings_of_policy
from readygo.services.evaluator import handle_evaluate
from readygo.services.evaluator.records import EpisodeRecord
from readygo.services.evaluator.scores import compare_all, scores_of
from readygo.services.trainer.finetune import load_network, save_network
from readygo.services.trainer.inputs import GOAL_SCALE_M, Fusion, GoalForm, MotionInput
from readygo.services.trainer.model import PolicyNet

NOISE = 0.1
"""Initial standard deviation of commands, as a share of the robot's limits."""
LIMIT_S = EpisodeConfig().time_limit_s
CRITIC_WIDTHS = [128, 128]
CRITIC_ROLLOUTS = 3
"""Number of first rollouts that train only the critic."""


class Rides(VecEnv):
    """`PointNavVectorEnv` for stable-baselines3; a robot's observation is the input of the policy's head."""

    def __init__(self, folder: Path, count: int, **arguments: Any) -> None:
        self._envs = make_vec(
            "readygo.gym:ReadyGo/PointNav-v0",
            num_envs=count,
            autoreset_mode=AutoresetMode.SAME_STEP,
            policy=folder,
            **arguments,
        )
        self._policy = policy = load_policy(folder)
        robot = policy.spec.robot
        self._limits = np.array([robot.v_max_mps, robot.w_max_radps], np.float32)
        self._memories = [policy.start() for _ in range(count)]
        self._inputs = inputs = load_network(folder).inputs
        if inputs.fusion is not Fusion.LATE or inputs.goal is not GoalForm.POINT or inputs.robot:
            raise PolicyError(f"{folder} must hold a policy of late fusion, for one robot, whose goal is a point.")
        features = spaces.Box(-np.inf, np.inf, (inputs.feature_count,), np.float32)
        shares = spaces.Box(np.float32([0.0, -1.0]), np.float32([1.0, 1.0]))
        self.outcomes: list[bool] = []
        """True for each finished episode that succeeded."""
        super().__init__(count, features, shares)

    def reset(self) -> np.ndarray:
        """Begin an episode for every robot; returns its observations, shape (B, F)."""
        observation, _ = self._envs.reset(seed=self._seeds[0])
        self._memories = [self._policy.start() for _ in self._memories]
        return self._features(self._memories, observation)

    def step_async(self, actions: np.ndarray) -> None:
        """Set the next commands, as shares of the robot's limits, shape (B, 2)."""
        self._actions = actions * self._limits

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Drive for 0.05 s."""
        observation, rewards, terminated, truncated, infos = self._envs.step(self._actions)
        ended, told = terminated | truncated, [{} for _ in self._memories]
        for k in np.flatnonzero(ended).tolist():
            last = {name: array[None] for name, array in infos["final_obs"][k].items()}
            told[k]["terminal_observation"] = self._features([self._memories[k]], last)[0]
            told[k]["TimeLimit.truncated"] = bool(truncated[k])
            self.outcomes.append(bool(infos["final_info"]["success"][k]))
            self._memories[k] = self._policy.start()
        return self._features(self._memories, observation), rewards, ended, told

    def _features(self, memories: Sequence[Any], observation: dict[str, np.ndarray]) -> np.ndarray:
        for memory, command in zip(memories, observation["velocity"], strict=True):
            memory.advance(command)
        self._policy.see(memories, observation["rgb"])
        # What it decides is not of interest, but its graph encodes the images.
        self._policy.decide(memories, observation["velocity"], observation["goal"])
        rows = []
        for memory, command, goal in zip(memories, observation["velocity"], observation["goal"], strict=True):
            latents = [frame.cached["latents"] for frame in memory.window()]
            poses = self._inputs.motion is MotionInput.POSES
            rows.append(np.concatenate([*latents, memory.own_motion(command) if poses else [*command, 1.0], goal]))
        return np.array(rows, np.float32)

    def close(self) -> None:
        """Release the scene."""
        self._envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of the environments, once for each robot."""
        return [getattr(self._envs, attr_name)] * len(self._memories)

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Not supported: single robots have no attributes to set."""
        raise NotImplementedError

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **arguments: Any) -> list[Any]:
        """Not supported: single robots have no methods."""
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """False for every robot: single robots have no wrappers."""
        return [False] * len(self._memories)


class ActorAndCritic(nn.Module):
    """The policy's head and a critic with the same inputs, instead of stable-baselines3's networks."""

    latent_dim_pi = 2

    def __init__(self, net: PolicyNet, critic: nn.Module, latent_dim_vf: int) -> None:
        super().__init__()
        self.head, self._net, self.critic, self.latent_dim_vf = net.head, [net], critic, latent_dim_vf

    def forward(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Outputs of actor and critic for features, shape (B, F)."""
        return self.forward_actor(features), self.forward_critic(features)

    def forward_actor(self, features: torch.Tensor) -> torch.Tensor:
        """Commands as shares of the robot's limits, shape (B, 2)."""
        net = self._net[0]
        return net.decide(net.act(*self._parts(features)))

    def forward_critic(self, features: torch.Tensor) -> torch.Tensor:
        """Features of the value function, shape (B, `latent_dim_vf`)."""
        latents, motion, goal = self._parts(features)
        return self.critic(torch.cat([latents, motion, goal / GOAL_SCALE_M], dim=1))

    def _parts(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        net = self._net[0]
        width = net.inputs.latents_width
        return features[:, :width], net.normalise_motion(features[:, width:-2]), features[:, -2:]


class Watch(BaseCallback):
    """Trains only the critic at first, ends training after the time budget, and prints the progress."""

    def __init__(self, head: nn.Module, rides: Rides, minutes: float) -> None:
        super().__init__()
        self._head, self._rides, self._rollouts = head, rides, 0
        self._begin_s, self._end_s = time.process_time(), time.process_time() + 60.0 * minutes

    def _on_rollout_end(self) -> None:
        self._rollouts += 1
        self._head.requires_grad_(self._rollouts > CRITIC_ROLLOUTS)
        recent = self._rides.outcomes[-50:]
        minutes = (time.process_time() - self._begin_s) / 60.0
        rate = f"{np.mean(recent):4.0%} of the last {len(recent)}" if recent else "none has ended"
        say(f"{minutes:5.1f} min  {self.num_timesteps:7d} steps  {len(self._rides.outcomes):4d} episodes, {rate}")

    def _on_step(self) -> bool:
        return time.process_time() < self._end_s


def fine_tune(folder: Path, rides: Rides, minutes: float, *, rollout_steps: int = 256) -> tuple[PolicyNet, int]:
    """Train a policy's head; returns the network and the number of steps."""
    net = load_network(folder)
    ppo = PPO(
        "MlpPolicy",
        rides,
        learning_rate=1e-4,
        n_steps=rollout_steps,
        batch_size=min(512, rollout_steps * rides.num_envs),
        n_epochs=4,
        gamma=0.995,
        clip_range=0.1,
        target_kl=0.02,
        seed=0,
        device="cpu",
        policy_kwargs={"net_arch": {"pi": [2], "vf": CRITIC_WIDTHS}, "log_std_init": math.log(NOISE)},
    )
    made = ppo.policy
    made.mlp_extractor = ActorAndCritic(net, made.mlp_extractor.value_net, CRITIC_WIDTHS[-1])
    made.action_net = nn.Identity()
    made.optimizer = torch.optim.Adam(made.parameters(), lr=ppo.learning_rate, eps=1e-5)
    ppo.learn(2**31, callback=Watch(net.head, rides, minutes))
    return net, ppo.num_timesteps


def drive(folder: Path, scene: str, episodes: int, name: str) -> list[EpisodeRecord]:
    """Drive a policy through the test episodes; the records carry `name` as their method."""
    policy = load_policy(folder)
    world = evaluation_world(scene, settings_of_policy(policy.spec), avatars=avatars_of_policy(policy.spec), seed=0)
    evaluator = make_evaluator(world, renderer=world.renderer(), policy=policy)
    request = make_request(episodes, ("static", "dynamic"), ("policy",), Split.TEST, 0)
    return [dataclasses.replace(record, method=name) for record in handle_evaluate(evaluator, request).records]


def say_success(before: Sequence[EpisodeRecord], after: Sequence[EpisodeRecord]) -> None:
    """Print success rates with 95 % intervals, and McNemar's test of the difference."""
    records = [*before, *after]
    for (task, name), scores in scores_of(records, time_limit_s=LIMIT_S).items():
        rate = scores["success"]
        say(f"{task.value:8s} {name:7s} success {rate.mean:4.0%} ({rate.low:.0%} to {rate.high:.0%}) of {rate.count}")
    for found in compare_all(records, "before", time_limit_s=LIMIT_S):
        say(
            f"{found.task.value:8s} only after {found.only_method}, only before {found.only_reference}: "
            f"p = {found.mcnemar_p:.2f}"
        )


def say(line: str) -> None:
    """Print a line, unbuffered."""
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


def main(arguments: Sequence[str] | None = None) -> None:
    """Fine-tune a policy, write it, and compare it with the original one."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("policy", nargs="?", type=Path, default=Path("out/policy"))
    parser.add_argument("--scene", default="embedded")
    parser.add_argument("--minutes", type=float, default=10.0, help="of training, in processor time")
    parser.add_argument("--episodes", type=int, default=50, help="per task, before and after")
    parser.add_argument("--robots", type=int, default=8, help="that drive side by side")
    parser.add_argument("--humans", type=int, default=2)
    parser.add_argument("--rollout-steps", type=int, default=256, help="of each robot between two updates")
    parser.add_argument("--out", type=Path, default=Path("out/finetuned"))
    asked = parser.parse_args(arguments)
    try:
        before = drive(asked.policy, asked.scene, asked.episodes, "before")
        rides = Rides(asked.policy, asked.robots, scene=asked.scene, humans=asked.humans)
        net, steps = fine_tune(asked.policy, rides, asked.minutes, rollout_steps=asked.rollout_steps)
        save_network(net, asked.policy, asked.out, {"by": "PPO", "steps": steps, "humans": asked.humans})
        say_success(before, drive(asked.out, asked.scene, asked.episodes, "after"))
    except ReadygoError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    main()
