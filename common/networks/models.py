"""The three networks: images of the last second or so and an image of the goal to waypoints."""

import itertools

import torch
from torch import nn
from torch.nn import functional

from readygo.common.networks.attention import PositionalEncoding, attention, attention_layer
from readygo.common.networks.efficientnet import CHANNELS, EfficientNet, batch_norm, group_norm
from readygo.common.networks.mobilenet import mobilenet_features
from readygo.common.networks.unet import ConditionalUnet, Ddpm

WAYPOINTS = 5
"""Waypoints that GNM and ViNT predict."""
NOMAD_WAYPOINTS = 8
NOMAD_LOW, NOMAD_HIGH = (-2.5, -4.0), (5.0, 4.0)
"""Range that NoMaD's steps are normalised by."""


class Gnm(nn.Module):
    """GNM, general navigation model: predicts waypoints and distance from images and the goal's image."""

    frames, width_px, height_px = 6, 85, 64
    """Images that it looks at, oldest first and 0.25 s apart, the present one included; their size."""

    def __init__(self) -> None:
        super().__init__()
        self.obs_mobilenet = mobilenet_features(3 * self.frames)
        self.compress_observation = nn.Sequential(nn.Linear(CHANNELS, 1024), nn.ReLU())
        self.goal_mobilenet = mobilenet_features(3 * self.frames + 3)
        self.compress_goal = nn.Sequential(nn.Linear(CHANNELS, 1024), nn.ReLU(), nn.Linear(1024, 1024), nn.ReLU())
        self.linear_layers = nn.Sequential(nn.Linear(2048, 256), nn.ReLU(), nn.Linear(256, 32), nn.ReLU())
        self.dist_predictor = nn.Sequential(nn.Linear(32, 1))
        self.action_predictor = nn.Sequential(nn.Linear(32, 4 * WAYPOINTS))
        _lay_out(self)

    def predict(self, images: torch.Tensor, goal: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Distances to the goal, in looks (B,), and places (B, 5, 4), see `waypoints`."""
        stacked = images.flatten(1, 2)
        seen = self.compress_observation(self.obs_mobilenet(stacked).mean(dim=(2, 3)))
        wanted = self.goal_mobilenet(torch.cat([stacked, goal], dim=1)).mean(dim=(2, 3))
        features = self.linear_layers(torch.cat([seen, self.compress_goal(wanted)], dim=1))
        return self.dist_predictor(features)[:, 0], _sum_steps(self.action_predictor(features))

    def waypoints(self, images: torch.Tensor, goal: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        """Images (B, frames, 3, H, W) and goals (B, 3, H, W) to places ahead, x forward and y left, (B, 5, 4).

        The unit is the way of 0.25 s at full speed; the last two of four values are the cosine and sine of the heading.
        """
        return self.predict(images, goal)[1]


class Decoder(nn.Module):
    """ViNT's attention over tokens, and what follows it."""

    def __init__(self, tokens: int, width: int) -> None:
        super().__init__()
        self.positional_encoding = PositionalEncoding(width, tokens)
        # Held a second time by the published weights.
        self.sa_layer = attention_layer(width, 4 * width)
        self.sa_decoder = attention(self.sa_layer)
        sizes = (tokens * width, 512, 256, 128, 64, 32)
        self.output_layers = nn.ModuleList(nn.Linear(a, b) for a, b in itertools.pairwise(sizes))

    def forward(self, tokens: torch.Tensor) -> torch.Tensor:
        """(B, tokens, width) -> (B, 32)."""
        x: torch.Tensor = self.sa_decoder(self.positional_encoding(tokens)).flatten(1)
        for layer in self.output_layers:
            x = functional.relu(layer(x))
        return x


class Vint(nn.Module):
    """ViNT, visual navigation transformer: predicts waypoints and distance from images and the goal's image."""

    frames, width_px, height_px = 6, 85, 64

    def __init__(self) -> None:
        super().__init__()
        self.obs_encoder, self.goal_encoder = EfficientNet(3, batch_norm), EfficientNet(6, batch_norm)
        self.compress_obs_enc, self.compress_goal_enc = nn.Linear(CHANNELS, 512), nn.Linear(CHANNELS, 512)
        self.decoder = Decoder(self.frames + 1, 512)
        self.dist_predictor = nn.Sequential(nn.Linear(32, 1))
        self.action_predictor = nn.Sequential(nn.Linear(32, 4 * WAYPOINTS))
        _lay_out(self)

    def predict(self, images: torch.Tensor, goal: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Distances to the goal, in looks (B,), and waypoints (B, 5, 4), as `Gnm.predict`."""
        features = self.decoder(_tokens(self, images, goal))
        return self.dist_predictor(features)[:, 0], _sum_steps(self.action_predictor(features))

    def waypoints(self, images: torch.Tensor, goal: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        """Waypoints ahead: x forward, y left, in units of 0.25 s at full speed, and heading, shape (B, 5, 4)."""
        return self.predict(images, goal)[1]


class VisionEncoder(nn.Module):
    """NoMaD's encoder of the images and the goal's image."""

    def __init__(self, frames: int) -> None:
        super().__init__()
        self.obs_encoder, self.goal_encoder = EfficientNet(3, group_norm), EfficientNet(6, group_norm)
        self.compress_obs_enc, self.compress_goal_enc = nn.Linear(CHANNELS, 256), nn.Linear(CHANNELS, 256)
        self.positional_encoding = PositionalEncoding(256, frames + 1)
        # Held a second time by the published weights.
        self.sa_layer = attention_layer(256, 1024)
        self.sa_encoder = attention(self.sa_layer)

    def forward(self, images: torch.Tensor, goal: torch.Tensor, hidden: torch.Tensor | None = None) -> torch.Tensor:
        """(B, frames, 3, H, W), (B, 3, H, W) -> (B, 256).

        Where `hidden`, booleans of shape (B,), is true, the goal is not looked at: nothing attends to its token, and
        the mean is that of the others.
        """
        tokens: torch.Tensor = self.positional_encoding(_tokens(self, images, goal))
        if hidden is None:
            hidden = torch.zeros(len(images), dtype=torch.bool, device=images.device)
        last = torch.arange(tokens.shape[1], device=images.device) == tokens.shape[1] - 1
        padding = hidden[:, None] & last
        encoded = self.sa_encoder(tokens, src_key_padding_mask=padding)
        seen: torch.Tensor = (encoded * ~padding[..., None]).sum(dim=1) / (~padding).sum(dim=1, keepdim=True)
        return seen


class Distance(nn.Module):
    """NoMaD's distance to the goal; who drives does not ask for it."""

    def __init__(self) -> None:
        super().__init__()
        self.network = nn.Sequential(nn.Linear(256, 64), nn.ReLU(), nn.Linear(64, 16), nn.ReLU(), nn.Linear(16, 1))

    def forward(self, condition: torch.Tensor) -> torch.Tensor:
        """What is encoded, (B, 256), to looks until the goal, (B,)."""
        distance: torch.Tensor = self.network(condition)
        return distance[:, 0]


class Nomad(nn.Module):
    """NoMaD with a goal: draws waypoints by diffusion from images and the goal's image."""

    frames, width_px, height_px = 4, 96, 96

    def __init__(self) -> None:
        super().__init__()
        self.vision_encoder = VisionEncoder(self.frames)
        self.noise_pred_net = ConditionalUnet(2, 256)
        self.dist_pred_net = Distance()
        _lay_out(self)

    def waypoints(self, images: torch.Tensor, goal: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
        """Waypoints ahead: x forward, y left, in units of 0.25 s at full speed, shape (B, 8, 2)."""
        condition, ddpm = self.vision_encoder(images, goal), Ddpm()
        sample = torch.randn((len(images), NOMAD_WAYPOINTS, 2), generator=generator)
        for step in reversed(range(len(ddpm.betas))):
            noise = self.noise_pred_net(sample, torch.full((len(images),), step), condition)
            sample = ddpm.back(sample, noise, step, generator)
        return places_of_steps(sample)


def places_of_steps(steps: torch.Tensor) -> torch.Tensor:
    """NoMaD's steps, in -1..1, to places ahead, shape (B, T, 2)."""
    low, high = torch.tensor(NOMAD_LOW), torch.tensor(NOMAD_HIGH)
    return ((steps + 1) / 2 * (high - low) + low).cumsum(dim=1)


def steps_of_places(places: torch.Tensor) -> torch.Tensor:
    """The inverse of `places_of_steps`."""
    low, high = torch.tensor(NOMAD_LOW), torch.tensor(NOMAD_HIGH)
    first = torch.zeros_like(places[:, :1])
    return (torch.diff(places, dim=1, prepend=first) - low) / (high - low) * 2 - 1


def _lay_out(network: nn.Module) -> None:
    """Channels last: convolutions train 1.2 to 1.7 times as fast on a CPU (GNM 1.2, NoMaD 1.2, ViNT 1.7)."""
    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]


def _tokens(encoder: Vint | VisionEncoder, images: torch.Tensor, goal: torch.Tensor) -> torch.Tensor:
    """A token per image, and one of the goal seen beside the present image."""
    encoded = encoder.compress_obs_enc(encoder.obs_encoder(images.flatten(0, 1)))
    wanted = encoder.compress_goal_enc(encoder.goal_encoder(torch.cat([images[:, -1], goal], dim=1)))
    return torch.cat([encoded.reshape(*images.shape[:2], -1), wanted[:, None]], dim=1)


def _sum_steps(actions: torch.Tensor) -> torch.Tensor:
    """Steps to places, headings to unit length."""
    actions = actions.reshape(-1, WAYPOINTS, 4)
    return torch.cat([actions[..., :2].cumsum(dim=1), functional.normalize(actions[..., 2:], dim=-1)], dim=-1)


NETWORKS: dict[str, type[Gnm] | type[Vint] | type[Nomad]] = {"gnm": Gnm, "vint": Vint, "nomad": Nomad}
