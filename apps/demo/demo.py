"""`readygo demo`: the whole pipeline on the embedded scene, in a few minutes."""

import dataclasses
import shutil
import sys
import time
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

from rich.text import Text

from readygo.apps.commands.learn import live_line
from readygo.apps.commands.reconstruct import Lines
from readygo.apps.demo.reconstruction import demo_reconstruction
from readygo.apps.evaluation.watch import AVOIDED, film_path
from readygo.apps.learn.config import LearnConfig
from readygo.apps.learn.gather import TEST_FOLDER
from readygo.apps.learn.learn import Learned, learn_policy, report_content
from readygo.apps.learn.plan import Budget, learn_settings, make_plan
from readygo.apps.pictures.episode_film import film_frames
from readygo.apps.pictures.film import write_film
from readygo.apps.pictures.recorded import RecordedEpisodes
from readygo.apps.report.learn import write_report
from readygo.apps.report.page import CommandLine
from readygo.apps.terminal import PlainConsole
from readygo.common.dataset import Dataset, Report, validate
from readygo.common.errors import DatasetError
from readygo.common.scenes.top_view import top_view
from readygo.runs.config import RunConfig
from readygo.runs.folder import check_new
from readygo.runs.scene_argument import open_scene
from readygo.runs.warm import warm_all
from readygo.runs.world import World
from readygo.services.evaluator import POLICY, EpisodeRecord, summary_table
from readygo.services.reconstructor import STAGES

MARKER = ".readygo-demo"
"""File that marks a folder as a demo's, which may be replaced."""
SCENE = "embedded"
ABSENT_FIRST = 400
"""Episodes without humans at the beginning: fewer than a few minutes record, so that the data show humans too."""
LEARN = LearnConfig(val_every=0.2, val_share=0.08)
"""Few measurements on the split val: in so few minutes they cost training time and hardly distinguish policies."""
SEARCHED = 20
"""Number of last episodes to search for the one that shows a human best; the first episodes have no humans."""


@dataclass(frozen=True, kw_only=True)
class _Timer:
    console: PlainConsole
    begin_s: float

    def say(self, text: str) -> None:
        self.console.print(Text.assemble((f"{time.monotonic() - self.begin_s:5.0f} s", "bold"), f"  {text}"))


@dataclass(frozen=True, kw_only=True)
class DemoOptions:
    """Train a policy in the embedded scene, evaluate it, and write a report and a video."""

    out: Path = Path("demo")
    """Folder for report.html, episode.webm and intermediate files; an earlier demo in it is replaced."""
    minutes: float = 3.3
    """Time of recording and training [min]."""
    episodes: int = 10
    """Test episodes per task, the same for every driver."""
    reconstruct: bool = False
    """Demonstrate reconstruction instead: film a room of the scene, reconstruct it from the video, record episodes
    in the result, and compare it with the ground truth, in reconstruction.html."""


def demo(options: DemoOptions) -> None:
    """Train a policy in the embedded scene, evaluate it, and write a report and a video."""
    try:
        _show(options)
    except KeyboardInterrupt:
        raise KeyboardInterrupt("the same command begins the demo again.") from None


def _show(options: DemoOptions) -> None:
    console = PlainConsole(stderr=True, soft_wrap=True)
    timer = _Timer(console=console, begin_s=time.monotonic())
    _clear(options.out)
    timer.say("compiling kernels (once per machine) and building the embedded scene")
    warm_all()
    if options.reconstruct:
        path = demo_reconstruction(open_scene(SCENE), options.out, timer.say, Lines(STAGES).say)
        timer.say("done")
        sys.stdout.write(f"Open {path}.\nNext, your own place: readygo marker --out marker.pdf, docs/own-place.md\n")
        return
    budget = Budget(minutes=options.minutes)
    plan = make_plan((SCENE,), options.out / "run", _settings(), LEARN, budget, avatars=None, seed=0)
    timer.say(
        f"recording and learning side by side for {options.minutes:g} min, "
        f"then {options.episodes} test episodes per task"
    )
    data = plan.places[0].folder.path
    with live_line(6 * options.episodes) as (show, _, tested), ProcessPoolExecutor(1, get_context("spawn")) as beside:
        checks: list[Future[Report]] = []

        def check_data() -> None:
            checks.append(beside.submit(validate, data))

        learned = learn_policy(
            plan, episodes=options.episodes, show=show, recorded=check_data, tested=tested, videos=(AVOIDED,)
        )
        _write_pictures(options.out, learned)
        report = checks[0].result()
    if not report.ok:
        raise DatasetError(f"{data} has defects, the first: {report.defects[0]}")
    images = plan.image_count(report.sample_count)
    timer.say(f"{report.sample_count:,} samples recorded, {images:,} with an image; all sound")
    console.print(summary_table(learned.replies[plan.places[0].name].summaries))
    timer.say("done")
    sys.stdout.write(
        f"Open {options.out / 'report.html'} and {options.out / 'episode.webm'}.\n"
        "Next, your own place: readygo scene import SCENE.ply --out out/place && "
        "readygo learn out/place --minutes 60 --out runs/place\n"
    )


def _settings() -> RunConfig:
    """Settings of `readygo learn`, but with humans from an earlier episode on."""
    usual = learn_settings(None, None)
    humans = dataclasses.replace(usual.human_planner, absent_first=ABSENT_FIRST)
    return dataclasses.replace(usual, human_planner=humans)


def _clear(out: Path) -> None:
    """Remove an earlier demo; any other non-empty folder is an error."""
    marker = out / MARKER
    if not marker.exists():
        check_new(out)
    out.mkdir(parents=True, exist_ok=True)
    marker.touch()
    shutil.rmtree(out / "run", ignore_errors=True)


def _write_pictures(out: Path, learned: Learned) -> None:
    place = learned.plan.places[0]
    world, dataset = World(place.spec), Dataset(place.folder.path)
    passed = closest_pass(learned.replies[place.name].records, learned.plan.out / TEST_FOLDER / place.name)
    if passed is not None:
        shutil.copyfile(passed, out / "episode.webm")
    else:
        recorded = RecordedEpisodes(dataset, world.scene.maps.robot)
        shown = recorded.best_encounter(list(dataset.episodes[-SEARCHED:]))
        write_film(out / "episode.webm", film_frames(recorded.film(shown), top_view(world.scene)))
    content = report_content(learned, (SCENE,))
    content = dataclasses.replace(
        content,
        title="readygo demo",
        video=out / "episode.webm",
        scores_note=f"{content.scores_note} A few minutes show the way, not what a policy can do.",
        next_steps=_next_steps(),
    )
    write_report(out / "report.html", content)


def closest_pass(records: Sequence[EpisodeRecord], test: Path) -> Path | None:
    """The film of the test episode in which the policy avoids a human most closely; None if it avoids none.

    Args:
        records: Test episodes.
        test: Their folder, with films of those alone.
    """
    near = sorted(records, key=lambda record: (record.human_distance_min_m, record.episode.index))
    films = [film_path(test, record) for record in near if record.method == POLICY]
    return next((film for film in films if film.exists()), None)


def _next_steps() -> tuple[CommandLine, ...]:
    return (
        CommandLine(what="bring a place", line="readygo scene import place.ply --name place --out out/place"),
        CommandLine(what="look at it", line="readygo scene inspect out/place"),
        CommandLine(what="learn", line="readygo learn out/place --minutes 60 --out runs/place"),
        CommandLine(what="measure", line="readygo evaluate out/place runs/place/policy --episodes 100"),
    )
