import numpy as np

from readygo.common.messages import (
    Humans,
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
