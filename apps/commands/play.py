"""`readygo play`: a recorded episode as a film."""

from pathlib import Path

from rich.console import Console

from readygo.apps.pictures.episode_film import film_frames
from readygo.apps.pictures.playback import background, recorded_film
from readygo.common.dataset import Dataset
from readygo.common.drawing.film import write_film
from readygo.common.errors import DatasetError
from readygo.common.robot.kinematics import RATE_HZ


def play(data: Path, /, *, out: Path, episode: int = 0, every: int = 2) -> None:
    """Write a recorded episode as a film: what the robot saw, beside its way and everybody's from above.

    Args:
        data: Data folder.
        out: Film to write, .mp4 or .webm.
        episode: Number of the episode in the folder, from 0; -1 is the last one.
        every: Samples from picture to picture, at the pace of the episode; 1 is 20 pictures per second.

    Raises:
        DatasetError: If there is no such episode.
        ReadygoError: If the film cannot be written.
    """
    dataset = Dataset([data])
    count = len(dataset.episodes)
    if not -count <= episode < count:
        raise DatasetError(f"{data} has no episode {episode}; it has {count}, from 0 to {count - 1}.")
    if not 1 <= every <= RATE_HZ:
        raise DatasetError(f"--every must be 1..{RATE_HZ}, got {every}.")
    number = episode % count
    frames = film_frames(recorded_film(dataset, number), background(dataset, number, data), step=every)
    write_film(out, frames, fps=max(1, round(RATE_HZ / every)))
    entry = dataset.episodes[number]
    words = f"{out}: {entry.episode.episode_id}, {entry.sample_count / RATE_HZ:.1f} s, {entry.outcome.value}"
    Console(highlight=False, soft_wrap=True).print(words, markup=False)
