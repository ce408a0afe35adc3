import numpy as np
import pytest

from readygo.common.messages import (
    Humans,
    RenderReply,
    RenderRequest,
    RenderView,
    decode,
    encode,
)


def test_render_request_keeps_camera_bits() -> None:
    T = np.random.default_rng(0).normal(size=(4, 4))
    humans = Humans(key="k", humans=())
    request = RenderRequest(views=(RenderView(people="k", step=0, T_world_camera=T),), people=(humans,))
    assert decode(RenderRequest, encode(request)).views[0].T_world_camera.tobytes() == T.tobytes()


def test_pose_and_path_of_a_view_must_have_their_shape() -> None:
    with pytest.raises(ValueError, match=r"T_world_camera must have shape \(4, 4\), got \(3, 4\)"):
        RenderView(people="k", step=0, T_world_camera=np.eye(4)[:3])
    with pytest.raises(ValueError, match="path_xyyaw must have rows of x, y and yaw"):
        RenderView(people="k", step=0, T_world_camera=np.eye(4), path_xyyaw=((0.0, 0.0, 0.0), (1.0, 0.0)))  # type: ignore[arg-type]


def test_images_of_a_reply_must_be_bytes() -> None:
    with pytest.raises(ValueError, match="rgb must be uint8"):
        RenderReply(rgb=np.zeros((1, 2, 3, 3), np.float32))
