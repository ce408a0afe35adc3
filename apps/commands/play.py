"""`readygo play`: writes a recorded episode as a video."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from readygo.apps.pictures.episode_film import film_frames
from readygo.apps.pictures.film import write_film
from readygo.apps.pictures.playback import background, recorded_film
from readygo.apps.terminal import PlainConsole
from readygo.common.dataset import Dataset
from readygo.common.errors import DatasetError


@dataclass(frozen=True, kw_only=True)
class PlayOptions:
    """Write a recorded episode as a video: the robot's camera images, beside a top view with all trajectories."""

    data: Positional[Path]
    """Data folder."""
    out: Path
    """Video to write, .mp4 or .webm."""
    episode: int = 0
    """Index of the episode in the folder, from 0; -1 is the last one."""
    every: int = 2
    """Samples from frame to frame; the video keeps the pace of the episode, and 1 shows every sample."""
    camera: str = ""
    """Name of the camera to show; by default all of them side by side, with depths if they are recorded."""


def play(options: PlayOptions) -> None:
    """Write a recorded episode as a video: the robot's camera images, beside a top view with all trajectories."""
    dataset = Dataset([options.data])
    count = len(dataset.episodes)
    if not -count <= options.episode < count:
        raise DatasetError(f"{options.data} has no episode {options.episode}; it has {count}, from 0 to {count - 1}.")
    rate_hz = dataset.clock.rate_hz
    if not 1 <= options.every <= rate_hz:
        raise DatasetError(f"--every must be 1..{rate_hz}, got {options.every}.")
    number = options.episode % count
    frames = film_frames(
        recorded_film(dataset, number, options.camera), background(dataset, number, options.data), step=options.every
    )
    write_film(options.out, frames, fps=rate_hz / options.every)
    entry = dataset.episodes[number]
    words = f"{options.out}: {entry.episode.episode_id}, {entry.sample_count / rate_hz:.1f} s, {entry.outcome.value}"
    PlainConsole(soft_wrap=True).print(words, markup=False)
