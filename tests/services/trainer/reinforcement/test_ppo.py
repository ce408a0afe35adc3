import copy

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="torch (extra train) is not installed")


class Corridor:
    """Robots that earn what their command's number says, and episodes of four decisions."""

    def __init__(self, count: int) -> None:
        self.told, self.truth = np.ones((count, 3), np.float32), np.ones((count, 4), np.float32)
        self._turn = 0

    def __len__(self) -> int:
        return len(self.told)

    def advance(self, commands: np.ndarray) -> object:
        from readygo.common.state_simulation.simulation import SUCCESS, Ended

        self._turn += 1
        count, ends = len(self.told), self._turn % 4 == 0
        return Ended(
            reward=commands[:, 0].astype(np.float32),
            ended=np.full(count, ends),
            outcome=np.full(count, SUCCESS if ends else 0, np.int8),
            length=np.full(count, 4),
            dynamic=np.ones(count, bool),
        )


def learner(seed: int = 0):
    from readygo.services.trainer.reinforcement.config import PpoConfig
    from readygo.services.trainer.reinforcement.ppo import Learner

    config = PpoConfig(robots=32, stretch=8, actor_widths=(16,), critic_widths=(16,), learning_rate=0.01)
    return Learner(Corridor(32), np.array([[0.0, 0.0], [1.0, 0.0], [0.2, 0.0]]), config, seed=seed)


def test_best_command_wins_and_ended_episodes_are_counted() -> None:
    learns = learner()
    for _ in range(40):
        figures = learns.update(learns.drive(), learning_rate=0.01, entropy=0.0)
    probabilities = torch.softmax(learns.actor(torch.ones(1, 3)), 1)[0]
    assert probabilities[1] > 0.9
    assert figures.entropy < 0.5
    assert learns.ended == {(True, 1): 40 * 32 * 2}


def test_advantages_end_with_the_episode() -> None:
    learns = learner()
    with torch.no_grad():
        for parameter in learns.critic.parameters():
            parameter.zero_()
    stretch = learns.drive()
    stretch.reward = torch.ones_like(stretch.reward)
    advantages, returns, _ = learns.advantages(stretch)
    decay = 0.99 * 0.95
    expected = [sum(decay**k for k in range(left)) for left in (4, 3, 2, 1, 4, 3, 2, 1)]
    assert advantages[:, 0].tolist() == pytest.approx(expected, rel=1e-5)
    assert torch.equal(advantages, returns)


def test_state_continues_with_the_same_bits() -> None:
    first, second = learner(), learner(seed=7)
    first.update(first.drive(), learning_rate=0.01, entropy=0.01)
    second.load_state(copy.deepcopy(first.state()))
    for learns in (first, second):
        learns.update(learns.drive(), learning_rate=0.01, entropy=0.01)
    assert all(torch.equal(a, b) for a, b in zip(first.actor.parameters(), second.actor.parameters(), strict=True))


def test_actor_takes_over_what_it_is_taught_and_keeps_it_while_the_critic_learns() -> None:
    learns, rng = learner(), np.random.default_rng(0)
    told = rng.normal(size=(600, 3)).astype(np.float32)
    weights = np.zeros((600, 3), np.float32)
    weights[np.arange(600), np.where(told[:, 0] > 0, 2, 0)] = 1.0
    assert learns.imitate(told, weights, epochs=60, batch=20) < 0.3
    taught = copy.deepcopy(learns.actor.state_dict())
    critic = copy.deepcopy(learns.critic.state_dict())
    learns.update(learns.drive(), learning_rate=0.01, entropy=0.01, critic_only=True)
    assert all(torch.equal(value, learns.actor.state_dict()[name]) for name, value in taught.items())
    assert not all(torch.equal(value, learns.critic.state_dict()[name]) for name, value in critic.items())
