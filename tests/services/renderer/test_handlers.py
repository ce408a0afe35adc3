import numpy as np

from readygo.common.messages import HumanMotion, Humans
from readygo.services.renderer import Renderer
from tests.services.renderer.asking import render, view


def test_views_come_back_in_order(renderer: Renderer) -> None:
    views = [view(renderer, yaw=yaw) for yaw in (0.0, 1.0, 2.0)]
    reply = render(renderer, *views)
    assert reply.rgb.shape == (3, 48, 80, 3)
    assert reply.unknown_people == ()
    for number, single in enumerate(views):
        assert np.array_equal(reply.rgb[number], render(renderer, single).rgb[0])
    assert not np.array_equal(reply.rgb[0], reply.rgb[1])


def test_humans_are_drawn_and_remembered(renderer: Renderer, human: HumanMotion) -> None:
    empty = render(renderer, view(renderer)).rgb[0]
    first = render(renderer, view(renderer, "walk"), people=(Humans(key="walk", humans=(human,)),)).rgb[0]
    assert (np.abs(first.astype(int) - empty).max(axis=2) > 20).mean() > 0.02
    assert np.array_equal(first, render(renderer, view(renderer, "walk")).rgb[0])


def test_unknown_humans_are_named_and_nothing_is_drawn(renderer: Renderer) -> None:
    reply = render(renderer, view(renderer), view(renderer, "nobody"))
    assert reply.unknown_people == ("nobody",)
    assert reply.rgb.shape == (0, 48, 80, 3)


def test_last_row_of_a_motion_is_held(renderer: Renderer, human: HumanMotion) -> None:
    people = (Humans(key="held", humans=(human,)),)
    reply = render(renderer, *(view(renderer, "held", step) for step in (2, 3, 4, 400)), people=people)
    assert not np.array_equal(reply.rgb[0], reply.rgb[1])
    assert np.array_equal(reply.rgb[1], reply.rgb[2])
    assert np.array_equal(reply.rgb[1], reply.rgb[3])
