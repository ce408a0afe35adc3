"""A hall with a wall, fake services on a bus, and a policy that drives at the goal."""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest

from readygo.common.bus import InProcessBus
from readygo.common.episode import EpisodeConfig
from readygo.common.maps import FloorMap, GridFrame, OccupancyMap
from readygo.common.messages import (
    AnimateReply,
    EpisodeMotions,
    HumanMotion,
    HumanPlanReply,
    HumanTrajectory,
    Motion,
    RenderReply,
    Scenario,
    topics,
)
from readygo.common.policy import PolicySpec
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.services.evaluator import EXPERT, Evaluator, EvaluatorConfig
from readygo.services.evaluator.drivers import StraightLineDriver

ROBOT = RobotConfig(camera=CameraConfig(height_px=8, width_px=10))
FRAME = GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.1)


def hall():
    """12 x 6 m with a wall at x = 8 m below y = 3 m."""
    occupied = np.zeros((60, 120), np.bool_)
    occupied[[0, -1]] = True
    occupied[:, [0, -1]] = True
    occupied[:30, 80] = True
    return OccupancyMap(frame=FRAME, occupied=occupied)


@dataclass
class FakeServices:
    """Odd indices are rejected; even ones start at (1, y) and go to (6, y), index 4 to behind the wall."""

    requests: list = field(default_factory=list)
    render_requests: list = field(default_factory=list)
    known_people: set = field(default_factory=set)
    forget_once: bool = False
    reject_all: bool = False

    def plan(self, request):
        self.requests.append(request)
        index = request.episode.index
        if index % 2 or self.reject_all:
            return HumanPlanReply(episode=request.episode, rejected="no way to the goal")
        y = 1.0 + 0.2 * index
        walker = HumanTrajectory(
            avatar="anna",
            encounter="crossing",
            speed_mps=1.0,
            xy_m=np.stack([np.full(40, 3.0 + index), np.linspace(5, 4, 40)], 1),
        )
        scenario = Scenario(
            episode=request.episode,
            start_xyyaw=np.array([1.0, y, 0.0]),
            goal_xy_m=np.array([10.0 if index == 4 else 6.0, y]),
            humans=(walker,),
        )
        return HumanPlanReply(episode=request.episode, scenario=scenario)

    def animate(self, request):
        humans = []
        for human in request.scenario.humans:
            root = np.concatenate([human.xy_m, np.ones((len(human.xy_m), 1))], axis=1).astype(np.float32)
            pose = np.zeros((len(root), 24, 3), np.float32)
            humans.append(HumanMotion(avatar=human.avatar, motion=Motion(root_m=root, pose_axis_angle=pose)))
        return AnimateReply(episode=request.scenario.episode, motions=EpisodeMotions(humans=tuple(humans)))

    def render(self, request):
        self.render_requests.append(request)
        self.known_people.update(item.key for item in request.people)
        if self.forget_once and len(self.render_requests) == 3:
            self.known_people.clear()
        unknown = {view.people for view in request.views if view.people} - self.known_people
        camera = ROBOT.camera
        count = 0 if unknown else len(request.views)
        rgb = np.zeros((count, camera.height_px, camera.width_px, 3), np.uint8)
        for image, view in zip(rgb, request.views, strict=False):
            image[:] = round(20 * view.T_world_camera[0, 3])
        outputs = {name: np.full(rgb.shape[:3], 2.0, np.float32) for name in request.outputs if count}
        return RenderReply(rgb=rgb, unknown_people=tuple(sorted(unknown)), outputs=outputs)


class Brightness(list):
    """What a policy remembers: how bright its images were."""

    def advance(self, command):
        """A step has no brightness."""


class GoalSeeker:
    """Stands in for a policy: drives at the goal, a little slower the brighter the image is."""

    def __init__(self, robot=ROBOT):
        self.spec = PolicySpec(robot=robot)

    def start(self, robot):
        return Brightness()

    def see(self, memories, images):
        for memory, image in zip(memories, images, strict=True):
            memory.append(int(image[0, 0, 0]))

    def decide(self, memories, previous, goals):
        speeds = [1.0 - memory[-1] / 1000 - len(memory) / 10000 for memory in memories]
        return np.array([(v, math.atan2(g[1], g[0])) for v, g in zip(speeds, goals, strict=True)], np.float32)


@pytest.fixture
def services():
    return FakeServices()


@pytest.fixture
def make_evaluator(services):
    bus = InProcessBus()
    bus.serve(topics.HUMAN_PLAN, services.plan)
    bus.serve(topics.ANIMATE, services.animate)
    bus.serve(topics.render("0"), services.render)

    def make(*, policy=None, robot=ROBOT, camera="policy", **settings):
        return Evaluator(
            bus=bus,
            robot=robot,
            camera=camera,
            robot_map=hall(),
            floor=FloorMap(frame=FRAME, height_m=np.full((60, 120), 0.25, np.float32)),
            episode_config=EpisodeConfig(),
            config=EvaluatorConfig(**settings),
            policy=policy if policy is not None else GoalSeeker(),
            drivers={EXPERT: lambda _: StraightLineDriver()},
        )

    return make
