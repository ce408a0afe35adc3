"""How a state policy is trained by reinforcement."""

from dataclasses import dataclass, field
from typing import Annotated

from readygo.common.config import Range, check_ranges
from readygo.common.perception.noise import PerceptionNoise
from readygo.common.state_simulation.simulation import RewardConfig
from readygo.common.state_simulation.world import ObservationConfig

Count = Annotated[int, Range(low=1)]
Share = Annotated[float, Range(low=0.0, high=1.0)]
Positive = Annotated[float, Range(above=0.0)]


@dataclass(frozen=True, kw_only=True)
class PpoConfig:
    """Proximal policy optimisation: Schulman et al. 2017, returns by generalised advantage estimation."""

    robots: Count = 512
    """Robots that drive side by side."""
    stretch: Count = 32
    """Decisions of each robot between two updates."""
    epochs: Count = 3
    """Passes over them."""
    minibatches: Count = 4
    """Parts of a pass."""
    learning_rate: Positive = 7e-4
    """Step size of Adam at first; falls linearly to a twentieth."""
    gamma: Share = 0.99
    """Discount per decision."""
    lam: Share = 0.95
    """Weight of longer returns."""
    clip: Positive = 0.2
    """Largest change of a decision's probability ratio that an update rewards."""
    entropy_first: Annotated[float, Range(low=0.0)] = 0.007
    """Weight of the entropy at first."""
    entropy_last: Annotated[float, Range(low=0.0)] = 0.001
    """Weight of the entropy at last."""
    gradient_max: Positive = 0.5
    """Largest norm of the gradients of each network."""
    actor_widths: tuple[int, ...] = (192, 192)
    """Hidden layers of the actor."""
    critic_widths: tuple[int, ...] = (192, 192)
    """Hidden layers of the critic, which learns from the truth (asymmetric actor-critic, Pinto et al. 2018)."""

    def __post_init__(self) -> None:
        check_ranges(self)


@dataclass(frozen=True, kw_only=True)
class ReinforcementConfig:
    """What is learned, and how."""

    hold_s: Positive = 0.2
    """Time that a command is held [s]."""
    static_share: Share = 0.15
    """Share of the episodes without people."""
    standing_max: Annotated[int, Range(low=0, high=4)] = 2
    """Most people who stand in the robot's way or beside it, besides those who walk; or `[human_planner]
    standing_max`, where that is more."""
    repeats: Share = 0.0
    """Chance that a robot that collided with a person begins the same episode again."""
    train_episodes: Count = 6000
    """Episodes of split train that robots drive in again and again."""
    demonstrations: Annotated[int, Range(low=0)] = 3000
    """Episodes of split train in which the expert teaches the actor first (DAgger); 0 begins with a random actor."""
    critic_first: Share = 0.04
    """After demonstrations: share of the budget in which the critic learns alone."""
    val_episodes: Count = 400
    """Episodes of split val that choose the weights."""
    val_every: Count = 1 << 20
    """Decisions between two choices."""
    observation: ObservationConfig = field(default_factory=ObservationConfig)
    noise: PerceptionNoise = field(default_factory=PerceptionNoise)
    reward: RewardConfig = field(default_factory=RewardConfig)
    ppo: PpoConfig = field(default_factory=PpoConfig)

    def __post_init__(self) -> None:
        check_ranges(self)
