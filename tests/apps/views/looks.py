"""Views whose sharpness and coverage are known."""

import numpy as np

from readygo.apps.views.views import SceneViews, ViewPlace
from readygo.services.renderer import Look


def place(x_m: float, y_m: float, sharpness: tuple[float, ...], coverage: float = 0.9) -> ViewPlace:
    return ViewPlace(
        looks=tuple(
            Look(
                xyyaw=(x_m, y_m, 1.5 * k),
                rgb=np.full((72, 128, 3), 40 * k, np.uint8),
                sharpness=value,
                coverage=coverage,
            )
            for k, value in enumerate(sharpness)
        )
    )


def views(blurred: int, bare: int, clear: int) -> SceneViews:
    dull, sharp = (9.0, 3.0, 12.0, 30.0), (20.0, 700.0, 500.0, 10.0)
    kinds = [(dull, 0.9)] * blurred + [(sharp, 0.1)] * bare + [(sharp, 0.9)] * clear
    return SceneViews(places=tuple(place(0.5 * k, 1.0, *kind) for k, kind in enumerate(kinds)))
