"""The networks are those of the published weights: numbers, names and shapes."""

import json
from pathlib import Path

import pytest

torch = pytest.importorskip("torch", reason="torch is not installed")

from readygo.common.networks import models  # noqa: E402

KEYS = Path(__file__).resolve().parents[3] / ".." / "shared" / "facts" / "nav_state_keys.json"
COUNTS = {"gnm": 8_663_797, "vint": 29_662_397, "nomad": 19_049_675}


@pytest.fixture(scope="module")
def networks():
    with torch.device("meta"):
        return {name: network() for name, network in models.NETWORKS.items()}


@pytest.mark.parametrize("name", COUNTS)
def test_parameters_are_as_many_as_published(networks, name):
    assert sum(parameter.numel() for parameter in networks[name].parameters()) == COUNTS[name]


@pytest.mark.parametrize("name", COUNTS)
def test_names_and_shapes_are_those_of_the_published_weights(networks, name):
    if not KEYS.is_file():
        pytest.skip("the published names and shapes (../shared/facts/nav_state_keys.json) are not on this machine")
    published = json.loads(KEYS.read_text())[name]
    assert {key: list(tensor.shape) for key, tensor in networks[name].state_dict().items()} == published


@pytest.mark.parametrize(("name", "shape"), [("gnm", (2, 5, 4)), ("vint", (2, 5, 4))])
def test_waypoints_are_summed_steps_and_headings(networks, name, shape):
    network = networks[name]
    with torch.device("meta"):
        images = torch.zeros(2, network.frames, 3, network.height_px, network.width_px)
        assert network.waypoints(images, images[:, 0], None).shape == shape


def test_steps_are_summed_and_headings_have_unit_length():
    actions = torch.ones(1, 20)
    summed = models._sum_steps(actions)
    assert summed[0, :, 0].tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert summed[0, :, 2:].norm(dim=-1).tolist() == pytest.approx([1.0] * 5)


def test_hidden_goal_changes_nothing_for_nomad():
    encoder = models.VisionEncoder(4).eval()
    images, goals = torch.rand(1, 4, 3, 96, 96), torch.rand(2, 3, 96, 96)
    with torch.inference_mode():
        seen, hidden = ([encoder(images, goal[None], torch.tensor([mask])) for goal in goals] for mask in (False, True))
    assert not torch.allclose(*seen)
    assert torch.allclose(*hidden)


def test_steps_of_nomad_lead_to_its_places():
    places = torch.tensor([[[1.0, 0.5], [2.5, 0.0], [3.0, -1.0]]])
    steps = models.steps_of_places(places)
    assert torch.allclose(models.places_of_steps(steps), places, atol=1e-6)
    assert float(steps.abs().max()) <= 1.0
