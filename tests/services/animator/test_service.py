import numpy as np

from readygo.benchmarks.motion.paths import floor, line
from readygo.common.bus import InProcessBus
from readygo.common.messages import (
    AnimateRequest,
    EpisodeKey,
    HumanTrajectory,
    Scenario,
    Split,
    decode,
    encode,
    topics,
)
from readygo.services.animator import Animator, AnimatorConfig, attach, handle_animate
from tests.services.animator.bodies import make_avatar


def test_decoded_requests_give_the_same_motion_over_the_bus() -> None:
    animator = Animator({"ada": make_avatar("ada")}, floor(), AnimatorConfig())
    human = HumanTrajectory(avatar="ada", encounter="crossing", speed_mps=1.2, xy_m=line(1.2))
    key = EpisodeKey(seed=1, split=Split.TRAIN, index=5)
    scenario = Scenario(episode=key, start_xyyaw=np.zeros(3), goal_xy_m=np.array([3.0, 0.0]), humans=(human,))
    request = AnimateRequest(scenario=scenario)
    bus = InProcessBus()
    attach(bus, animator)
    over = bus.request(topics.ANIMATE, decode(AnimateRequest, encode(request)))
    assert over.motions is not None
    assert encode(handle_animate(animator, request)) == encode(over)
