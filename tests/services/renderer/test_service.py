import numpy as np

from readygo.common.bus import InProcessBus
from readygo.common.messages import RenderRequest, RenderView, topics
from readygo.services.renderer import Renderer, attach
from readygo.services.renderer.handlers import handle_render


def test_renderer_answers_under_its_name(renderer: Renderer) -> None:
    bus = InProcessBus()
    attach(bus, renderer, "7")
    pose = renderer.robot.camera.T_world_camera(0, 0, 0, 0.0)
    request = RenderRequest(views=(RenderView(people="", step=0, T_world_camera=pose),))
    assert np.array_equal(bus.request(topics.render("7"), request).rgb, handle_render(renderer, request).rgb)
