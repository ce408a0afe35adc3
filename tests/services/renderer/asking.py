"""Requests to a renderer."""

from readygo.common.messages import Humans, RenderReply, RenderRequest, RenderView
from readygo.services.renderer import Renderer
from readygo.services.renderer.handlers import handle_render


def view(renderer: Renderer, people: str = "", step: int = 0, yaw: float = 0.0) -> RenderView:
    return RenderView(people=people, step=step, T_world_camera=renderer.robot.camera.T_world_camera(0, 0, yaw, 0.0))


def render(renderer: Renderer, *views: RenderView, people: tuple[Humans, ...] = ()) -> RenderReply:
    return handle_render(renderer, RenderRequest(views=views, people=people))
