"""`readygo play`: writes a recorded episode as a video."""

from pathlib import Path

from readygo.apps.pictures.episode_film import film_frames
from readygo.apps.pictures.playback import background, recorded_film
from readygo.apps.terminal import PlainConsole
from readygo.common.dataset import Dataset
from readygo.common.drawing.film import write_film
from readygo.common.errors import DatasetError


def play(data: Path, /, *, out: Path, episode: int = 0, every: int = 2, camera: str = "") -> None:
    """Write a recorded episode as a video: the robot's camera images, beside a top view with all trajectories.

    Args:
        data: Data folder.
        out: Video to write, .mp4 or .webm.
        episode: Index of the episode in the folder, from 0; -1 is the last one.
        every: Samples from frame to frame; the video keeps the pace of the episode, and 1 shows every sample.
        camera: Name of the camera to show; by default all of them side by side, with depths if they are recorded.

    Raises:
        DatasetError: If there is no such episode or camera.
        ReadygoError: If the video cannot be written.
    """
    dataset = Dataset([data])
    count = len(dataset.episodes)
    if not -count <= episode < count:
        raise DatasetError(f"{data} has no episode {episode}; it has {count}, from 0 to {count - 1}.")
    rate_hz = dataset.clock.rate_hz
    if not 1 <= every <= rate_hz:
        raise DatasetError(f"--every must be 1..{rate_hz}, got {every}.")
    number = episode % count
    frames = film_frames(recorded_film(dataset, number, camera), background(dataset, number, data), step=every)
    write_film(out, frames, fps=max(1, round(rate_hz / every)))
    entry = dataset.episodes[number]
    words = f"{out}: {entry.episode.episode_id}, {entry.sample_count / rate_hz:.1f} s, {entry.outcome.value}"
    PlainConsole(soft_wrap=True).print(words, markup=False)
