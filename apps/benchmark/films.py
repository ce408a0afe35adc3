"""Films of a leaderboard: the median and the worst episode of each row, from the kept commands."""

import hashlib
import json
import re
from pathlib import Path

from readygo.apps.benchmark.leaderboard import Leaderboard, films_to_show
from readygo.apps.evaluation.replay import Replays
from readygo.apps.evaluation.watch import FILM_ENDING, FILMS_FOLDER
from readygo.apps.report.evaluation import WORDS
from readygo.apps.report.page import MediaFigure
from readygo.common.errors import RunError
from readygo.runs.benchmark.folder import cell_folder
from readygo.runs.benchmark.suite import OpenSuite
from readygo.runs.evaluation import make_evaluator
from readygo.services.evaluator import EpisodeRecord, as_task, read_results, short_name


def film_leaderboard(board: Leaderboard, out: Path) -> list[MediaFigure]:
    """Write the films of a leaderboard that do not exist yet, below the folder of its page.

    Args:
        board: Rows, and the folders of their records.
        out: Folder of the page.

    Raises:
        ReadygoError: If a scene is missing, an episode goes differently here, or a film cannot be written.
    """
    figures = []
    for row, word, record in films_to_show(board):
        path = out / FILMS_FOLDER / film_name(board.suite, record)
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            _film(board.suite, board.folders[record.method], record, path)
        said = f"{short_name(row.name)}, the {word} of {board.suite.suite.paper_cell}: {WORDS[record.result.outcome]}"
        figures.append(
            MediaFigure(video=f"{FILMS_FOLDER}/{path.name}", caption=f"{said} after {record.result.duration_s:.1f} s.")
        )
    return figures


def film_name(suite: OpenSuite, record: EpisodeRecord) -> str:
    """A name that no other record has, as a page may be written again into a folder.

    Args:
        suite: Suite of the record.
        record: What is filmed.
    """
    digest = hashlib.sha256(f"{suite.sha256} {json.dumps(record.to_mapping())}".encode()).hexdigest()
    driver = re.sub(r"[^\w.-]", "-", record.method)
    return f"{driver}-{record.episode.episode_id}-{digest[:8]}{FILM_ENDING}"


def _film(suite: OpenSuite, folder: Path, record: EpisodeRecord, path: Path) -> None:
    scene = next(name for name, place in suite.suite.scenes.items() if place.seed == record.episode.seed)
    world = suite.world(suite.suite.paper_cell, scene)
    evaluator = make_evaluator(world, methods={})
    dynamic, reason = evaluator.source().among_humans(record.episode)
    if dynamic is None:
        raise RunError(f"{record.episode.episode_id} has no scenario here: {reason}.")
    with read_results(cell_folder(folder, suite.suite.paper_cell, scene)) as results:
        replays = Replays(world, results, [as_task(dynamic, record.task)], None, evaluator.simulation)
        if not replays.load([record]):
            raise RunError(f"{folder} does not keep what {record.episode.episode_id} was driven with.")
        replays.film(path, record)
