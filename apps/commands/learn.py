"""`readygo learn`: record data in a scene and train a policy on them at the same time."""

import dataclasses
import json as json_module
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from rich.progress import BarColumn, TaskProgressColumn, TextColumn
from tyro.conf import Fixed, Positional

from readygo.apps.commands.progress import SteadyProgress
from readygo.apps.fleet.access import how_to_join, identity_for
from readygo.apps.fleet.options import RouterOptions
from readygo.apps.learn.config import GoalName, LearnConfig
from readygo.apps.learn.crew import Reach
from readygo.apps.learn.learn import learn_policy, report_content
from readygo.apps.learn.paper import REFINED_SHARE, data_of, first_plan, minutes_after, policy_keys, teacher_of
from readygo.apps.learn.perceive import BESIDE, Perceived, Step, learn_to_perceive, perception_content
from readygo.apps.learn.perceive_plan import PerceivePlan, check_plan, not_one_camera, perceive_settings
from readygo.apps.learn.plan import FIRST_FOLDER, STATE, Budget, LearnPlan, learn_configs, make_plan
from readygo.apps.learn.refine import refine
from readygo.apps.learn.supervise import Now
from readygo.apps.monitor.beside import show_page
from readygo.apps.options import given_options
from readygo.apps.report.learn import write_report
from readygo.apps.report.perception import reason, write_perception_report
from readygo.apps.terminal import PlainConsole
from readygo.common.bus.identity import COORDINATOR
from readygo.common.errors import RunError
from readygo.runs.config import RunConfig
from readygo.runs.sections import Keys, Sections, read_sections
from readygo.runs.trained import check_out
from readygo.services.evaluator import EpisodeRecord, EvaluateReply, summary_table
from readygo.services.trainer import MINUTES

_NOT_IN_REPORT = ("scenes", "out", "minutes", "samples", "on", "watch", "json", "fleet")
"""Fields and groups that the report's command to resume leaves out, or sets itself."""
_OF_ALL_FORMS = ("scenes", "out", "form", "minutes", "episodes", "seed", "robot", "config", "json", "avatars")
"""Fields and groups that the form "perceive" takes."""
_OF_PAPER = (*_OF_ALL_FORMS, "watch", "learn")
"""Fields, groups and sections that the form "paper" takes."""
PERCEIVE, PAPER, POLICY_FORM = "perceive", "paper", "policy"
Show = Callable[[Now], None]
ShowStep = Callable[[Step], None]
Tested = Callable[[EpisodeRecord], None]
Refined = Callable[[LearnPlan, ShowStep], Path]


@dataclass(frozen=True, kw_only=True)
class LearnTrainingOptions:
    """Budget, goal input, cameras, avatars, teacher and encoder of the training."""

    samples: int | None = None
    """Training budget in samples, repeats counted, instead of minutes: the result depends less on the machine's
    load."""
    avatars: Path | None = None
    """Avatar file or folder of avatars; the embedded ones by default. Of eight or more, a quarter is kept for the test
    (`readygo evaluate --avatars FOLDER:test`), and the others walk in the data."""
    goal: GoalName | None = None
    """Goal input of the policy: "point" (the default) is its position, "image" the robot's view at the goal, or
    "both"."""
    cameras: str = ""
    """Cameras of the robot that the policy uses, by their names in robot.toml, including the first one; only the
    first one by default."""
    teacher: Path | None = None
    """Folder of a state policy for this robot, from `readygo rl`: it labels every sample instead of the expert, and
    drives the expert's episodes. Or "expert-tracked": the expert that knows people by tracks of simulated
    detections."""
    perception: Path | None = None
    """Folder of trained perception (`readygo train --recipe perception`): its network is the policy's encoder, and its
    robot is the default. By default the encoder learns with the policy."""


@dataclass(frozen=True, kw_only=True)
class LearnOptions:
    """Record episodes and train a policy at the same time; run the same command again to resume.

    First the expert drives, with noise injection. Then DAgger: the current policy drives most episodes, and the expert
    labels every sample. The policy with the best success rate on the split val is kept and evaluated on the split test.
    """

    scenes: Positional[tuple[str, ...]]
    """Scene bundles, "embedded", "embedded:SEED" or "embedded:plan-SEED"; one policy learns in all of them."""
    out: Path
    """Folder of the run, new or to resume: data, policy, curve.json, evaluation and report.html."""
    form: Literal["auto", "perceive", "paper", "policy"] = "auto"
    """What is learned: "perceive", a network that sees people and free space, with which a planner or a policy on
    states drives on the map; "policy", a policy from images to commands, without a map; "paper", both: 40 % of the
    time for "perceive", then a policy whose encoder is that network and whose teacher is the policy on states
    (or what `--learn.teacher` names), and in the last 30 % both networks again, from all images. "auto" takes
    "perceive", which reaches more goals among people, unless an option or key is given that only policies have."""
    minutes: float = 60.0
    """Wall time of recording and training, including earlier calls [min]; training ends earlier if the policy
    stops improving. The test is not included."""
    episodes: int = 100
    """Test episodes per task and scene, each driven by the policy, the expert and a straight-line baseline; 0: no
    test."""
    seed: int = 0
    """Seed of the episodes and of the training."""
    robot: Path | None = None
    """robot.toml; a policy's camera has 72x128 pixels without a camera in it, or without the file."""
    config: Path | None = None
    """TOML file with sections of settings, as for `readygo generate`, and [learn]; `--SECTION.KEY VALUE` overrides
    it."""
    inputs: str = ""
    """Images that the policy uses and that are recorded, separated by commas: rgb, depth; rgb by default."""
    on: Literal["local", "hosts"] = "local"
    """Where episodes are driven: "local" shares this machine's cores between driving and training; "hosts" uses
    them for training only, and `readygo worker all` drives on other machines."""
    watch: bool = False
    """Show the run live on a web page, as `readygo monitor` does."""
    json: bool = False
    """Print the result as JSON."""
    training: LearnTrainingOptions = field(default_factory=LearnTrainingOptions)
    fleet: RouterOptions = field(default_factory=RouterOptions)
    keys: Annotated[Keys, Sections(RunConfig, learn=LearnConfig), Fixed] = field(default_factory=dict)


def learn(options: LearnOptions) -> None:
    """Record episodes and train a policy at the same time; run the same command again to resume."""
    if options.episodes < 0:
        raise RunError(f"--episodes must be at least 0, got {options.episodes}.")
    if options.minutes not in MINUTES:
        raise RunError(f"--minutes must be {MINUTES}, got {options.minutes:g}.")
    check_out(options.out)
    form = _form(options)
    if form == PERCEIVE:
        _learn_to_perceive(options)
    elif form == PAPER:
        _learn_as_the_paper(options)
    else:
        _learn_policy(options, given_options(options, _NOT_IN_REPORT))


def _learn_policy(
    options: LearnOptions, given: Mapping[str, str], people: Path | None = None, refined: Refined | None = None
) -> None:
    """Record, train a policy, test it, and write the report.

    Args:
        options: What the run is told.
        given: Options of the command in the report that learns on.
        people: Varied avatars that walk in the data; by default the avatars that are not kept for the test.
        refined: Trains another policy of the plan on its data, telling its progress, and answers its folder.
    """
    if options.on == "hosts" and not options.fleet.listen:
        raise RunError("--on hosts needs --listen with an address that they reach, such as tls/10.0.0.5:7447.")
    if options.fleet.listen or options.fleet.certs:
        # Check certificates before any work is done.
        identity_for(options.fleet.listen, COORDINATOR, certs=options.fleet.certs)
    plan = make_plan(
        options.scenes,
        options.out,
        *learn_configs(
            options.config,
            options.robot,
            options.inputs,
            options.training.cameras,
            options.training.goal,
            scene_count=max(len(options.scenes), 1),
            perception=options.training.perception,
            keys=options.keys,
        ),
        Budget(minutes=options.minutes, samples=options.training.samples),
        avatars=options.training.avatars,
        seed=options.seed,
        people=people,
        teacher=options.training.teacher,
        perception=options.training.perception,
    )
    if options.fleet.listen:
        state = plan.places[0].folder.state
        sys.stderr.write(f"{how_to_join(state, 'all', options.fleet.listen, certs=options.fleet.certs)}\n")
    reach = Reach(listen=options.fleet.listen, certs=options.fleet.certs, hosts=options.on == "hosts")
    page = show_page(options.out, partial(_has_begun, plan), options.fleet.certs) if options.watch else nullcontext()
    with page, live_line(6 * options.episodes * len(options.scenes), quiet=options.json) as (show, step, tested):
        learned = learn_policy(
            plan,
            episodes=options.episodes,
            show=show,
            tested=tested,
            reach=reach,
            refine=partial(refined, plan, step) if refined else None,
        )
    report = options.out / "report.html"
    write_report(report, report_content(learned, options.scenes, given))
    if options.json:
        sys.stdout.write(json_module.dumps(learned.to_mapping()) + "\n")
        return
    console = PlainConsole(soft_wrap=True)
    _print_tables(console, learned.replies)
    console.print(f"The policy: {plan.policy}. How it learned and what it fails in: {report}", markup=False)


def _form(options: LearnOptions) -> str:
    """The form that is learned.

    Raises:
        RunError: If an option is given that this form has not.
    """
    if options.form == POLICY_FORM:
        return POLICY_FORM
    if options.form == PAPER or (options.form == "auto" and (options.out / FIRST_FOLDER).is_dir()):
        if given := _given_beside(options, _OF_PAPER):
            raise RunError(f"--form {PAPER} takes no {', '.join(given)}.")
        return PAPER
    given = _given_beside(options, _OF_ALL_FORMS)
    if not given and options.config and "learn" in read_sections(options.config):
        given = [f"[learn] in {options.config}"]
    if options.form == "auto" and (given or (options.out / STATE).exists()):
        return POLICY_FORM
    if options.form == "auto" and not_one_camera(perceive_settings(options.config, options.robot, options.keys).robot):
        return POLICY_FORM
    if given:
        raise RunError(f"--form {PERCEIVE} takes no {', '.join(given)}.")
    return PERCEIVE


def _given_beside(options: LearnOptions, taken: tuple[str, ...]) -> list[str]:
    """The options that are given, besides some fields, groups and sections, and the sections of a run."""
    of_runs = [section.name for section in dataclasses.fields(RunConfig)]
    return [*given_options(options, (*taken, *of_runs))]


def _learn_to_perceive(options: LearnOptions) -> None:
    """Record, train perception, test it, and write the report."""
    plan = PerceivePlan(
        out=options.out,
        scenes=options.scenes,
        config=perceive_settings(options.config, options.robot, options.keys),
        minutes=options.minutes,
        avatars=options.training.avatars,
        seed=options.seed,
    )
    check_plan(plan)
    learned = _perceive(plan, options.episodes, quiet=options.json)
    if options.json:
        sys.stdout.write(json_module.dumps(learned.to_mapping()) + "\n")
        return
    console = PlainConsole(soft_wrap=True)
    _print_tables(console, learned.replies)
    report = options.out / "report.html"
    console.print(f"The network: {plan.perception}. It drives as the method {learned.method}.", markup=False)
    console.print(f"{reason(perception_content(learned, plan.scenes))} All of it: {report}", markup=False)


def _learn_as_the_paper(options: LearnOptions) -> None:
    """Learn to perceive and to act on states, then a policy from images which these teach."""
    first = first_plan(
        options.scenes,
        options.out,
        config=options.config,
        robot=options.robot,
        keys=options.keys,
        minutes=options.minutes,
        avatars=options.training.avatars,
        seed=options.seed,
    )
    if not (options.out / STATE).exists():
        _perceive(first, 0, quiet=options.json)
    given = given_options(options, _NOT_IN_REPORT) | {"--minutes": f"{2 * options.minutes:g}"}
    training = dataclasses.replace(options.training, perception=first.perception, teacher=teacher_of(first))
    rest = dataclasses.replace(
        options,
        minutes=minutes_after(first, options.minutes),
        training=training,
        keys=policy_keys(options.keys, options.config),
    )
    refined = partial(refine, before=data_of(first), minutes=REFINED_SHARE * options.minutes)
    _learn_policy(rest, given, first.people, refined)


def _perceive(plan: PerceivePlan, episodes: int, *, quiet: bool) -> Perceived:
    """Record, train perception and a policy on states, test them, and write the report, with a line on the terminal."""
    columns = (TextColumn("{task.description}"), BarColumn(20), TaskProgressColumn(), TextColumn("{task.fields[said]}"))
    with SteadyProgress(*columns, quiet=quiet) as progress:
        task = progress.add_task("recording", total=1.0, said="")
        testing = progress.add_task(
            "test", total=(1 + len(BESIDE)) * 2 * episodes * len(plan.scenes), said="", visible=False
        )

        def show(step: Step) -> None:
            progress.update(task, description=step.name, completed=step.fraction, said=step.words)

        def show_test(record: EpisodeRecord) -> None:
            progress.update(testing, advance=1, visible=True, said=f"{record.task.value}, {record.method}")

        learned = learn_to_perceive(plan, episodes=episodes, show=show, tested=show_test)
    write_perception_report(plan.out / "report.html", perception_content(learned, plan.scenes))
    return learned


def _print_tables(console: PlainConsole, replies: Mapping[str, EvaluateReply]) -> None:
    for name, reply in replies.items():
        console.print(name, markup=False)
        console.print(summary_table(reply.summaries))


def _has_begun(plan: LearnPlan) -> bool:
    return all((place.folder.state / "endpoint").exists() for place in plan.places)


@contextmanager
def live_line(tested_total: int, *, quiet: bool = False) -> Iterator[tuple[Show, ShowStep, Tested]]:
    """Show the progress of training, of a training after it and of the test; `quiet` shows nothing."""
    columns = (TextColumn("{task.description}"), BarColumn(20), TaskProgressColumn(), TextColumn("{task.fields[said]}"))
    with SteadyProgress(*columns, quiet=quiet) as progress:
        task = progress.add_task("learning", total=1.0, said="starting")

        def show(now: Now) -> None:
            progress.update(task, completed=now.fraction, said=line_of(now))

        def show_step(step: Step) -> None:
            progress.update(task, description=step.name, completed=step.fraction, said=step.words)

        testing = progress.add_task("test", total=tested_total, said="", visible=False)

        def show_test(record: EpisodeRecord) -> None:
            progress.update(testing, advance=1, visible=True, said=f"{record.task.value}, {record.method}")

        yield show, show_step, show_test


def line_of(now: Now) -> str:
    """Progress of a training run in one line: times, sample counts and success rates."""
    times = f" ({now.learned / now.images:.1f} times each)" if now.images and now.learned else ""
    parts = [
        f"{now.minutes:.1f} min",
        f"{now.samples:,} samples recorded",
        f"{now.images:,} with an image",
        f"{now.learned:,} learned from{times}",
        f"{now.policies} policies",
    ]
    if now.driven is not None:
        parts.append(f"driving SR {100 * now.driven:.0f} %")
    if now.latest is not None:
        parts.append(f"val SR {100 * now.latest.static:.0f} / {100 * now.latest.dynamic:.0f} %")
    return ", ".join(parts)
