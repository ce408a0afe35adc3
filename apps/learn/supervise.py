"""The supervisor of a learning run: from the first episode until its budget is spent or nothing improves."""

import dataclasses
import math
import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from readygo.apps.learn.background import Background
from readygo.apps.learn.choice import PolicyMeasurement, best_of, episodes_to_measure, has_stopped_rising
from readygo.apps.learn.cores import CoreSplit, is_ahead, split_cores
from readygo.apps.learn.crew import ALONE, Crew, Reach
from readygo.apps.learn.curve import CurvePoint, load_curve, measurements_of, save_curve
from readygo.apps.learn.measure import Measured, Measuring
from readygo.apps.learn.plan import Budget, LearnPlan, read_state, write_state
from readygo.apps.learn.training import Training, begin_decay, decay_share, forget_decay, read_training
from readygo.common.config import section_to_mapping
from readygo.common.cores import available_cores
from readygo.common.errors import RunError
from readygo.common.files import unfinished_folder, write_whole
from readygo.common.policy.artifact import POLICY_FILES, SPEC_FILE, WEIGHTS_FILE
from readygo.runs.origin import note_origin, origin_of_runs
from readygo.runs.policy import policy_sha256
from readygo.services.evaluator import EpisodeRecord

TICK_S = 0.5
SAVE_S = 5.0
"""Period of saving the spent time [s]."""
POINTS = 100
"""Number of points of the curve over the budget, besides the measurements."""
LATE = 1.1
"""Share of the budget after which a trainer that still runs is ended."""
EPISODE_S = 1.5
"""Assumed time of an episode before the first measurement [s]."""
SPLIT_S = 30.0
"""Training time after which measured rates determine the division of the cores [s]."""
VAL_EPISODES_MAX = 50
"""Most episodes per task of one measurement."""
TAKEN_EPISODES_MAX = 100
"""Most episodes per task for a policy that learned elsewhere: the best of many shorter measurements is partly luck."""
CANDIDATES = 3
"""Number of offered policies that stay for measurements, besides the best one."""
EPISODES_HZ = 5.0
"""Upper bound of the episodes that a collector records per second [Hz]; it determines a run's wanted episodes."""


@dataclass(frozen=True, kw_only=True)
class Now:
    """Current progress of a learning run."""

    fraction: float
    """Share of the budget that is spent."""
    minutes: float
    samples: int
    """Number of samples in the shards."""
    images: int
    """Number of samples with an image, which training draws from."""
    learned: int
    """Number of samples that training has used, repeats counted."""
    policies: int
    driven: float | None
    """Success rate of the latest recorded policy-driven episodes; None before there are any."""
    latest: PolicyMeasurement | None
    """Latest measurement on the split val; None before the first."""


class Supervisor:
    """Supervisor of one learning run; its state is on disk, so that it resumes after any interruption."""

    def __init__(
        self, plan: LearnPlan, measuring: Measuring, show: Callable[[Now], None], reach: Reach = ALONE
    ) -> None:
        """Read the state in the run's folder, and resume from there.

        Raises:
            RunError: If its files are broken.
        """
        self._plan, self._measuring, self._show, self._reach = plan, measuring, show, reach
        state = read_state(plan)
        self._spent_s = float(state.get("spent_s", 0.0))
        self._over = state.get("over") == section_to_mapping(plan.budget)
        self._split = CoreSplit(**state["split"]) if "split" in state else None
        self._begun_decay = False
        self._episode_s = EPISODE_S
        self.points = load_curve(plan.curve_file)
        """Learning curve so far."""
        # Folders of earlier versions do not name the budget of a run that is not over.
        if state.get("budget", state.get("over", section_to_mapping(plan.budget))) != section_to_mapping(plan.budget):
            self.points = [_of_budget(point, plan.budget) for point in self.points]

    @property
    def minutes(self) -> float:
        """Time spent, including earlier commands [min]."""
        return self._spent_s / 60

    @property
    def measurements(self) -> list[PolicyMeasurement]:
        """All measurements on the split val, in order."""
        return measurements_of(self.points)

    def learn(self) -> PolicyMeasurement | None:
        """Train until the budget is spent or nothing improves; returns the measurement of the policy that is kept.

        Raises:
            RunError: If the run cannot continue, or no policy was trained.
        """
        plan = self._plan
        if not self._over:
            self._prepare()
            background: Background[Measured] = Background()
            try:
                with Crew(plan, self._first_split(), self._reach) as crew, background:
                    self._supervise(crew, background)
            finally:
                self._save()
            self._measure_last()
            self._over = True
            self._save()
        return self._kept

    def _prepare(self) -> None:
        """Write the files that the processes read, which make the folder a learning run."""
        plan = self._plan
        if self.points:
            # Before the state, which says that the curve's shares are of this budget.
            save_curve(plan.curve_file, self.points)
        self._save()
        plan.policy.mkdir(exist_ok=True)
        forget_decay(plan.policy)
        collectors = max(available_cores(), len(plan.places))
        minutes = plan.budget.minutes if plan.budget.samples is None else 60.0
        wanted = math.ceil(60 * minutes * EPISODES_HZ * collectors)
        for place in plan.places:
            with place.folder.lock():
                before = place.folder.load()[1] if place.folder.ledger.exists() else 0
                place.folder.save(place.spec, max(wanted, before))

    def _first_split(self) -> CoreSplit:
        cores = available_cores()
        if self._reach.hosts:
            return CoreSplit(0, cores)
        if self._split:
            return self._split
        return split_cores(cores, scenes=len(self._plan.places), collect_hz=1.0, train_hz=1.0, reuse=1.0)

    def _supervise(self, crew: Crew, background: "Background[Measured]") -> None:
        before_s = saved_s = time.monotonic()
        begun_s = time.time()
        while True:
            time.sleep(TICK_S)
            training = read_training(self._plan.policy, begun_s)
            crew.check(training)
            now_s = time.monotonic()
            self._spent_s, before_s = self._spent_s + now_s - before_s, now_s
            fraction = self._fraction(training)
            self._measure(crew, training, background, fraction)
            self._split_again(crew, training)
            crew.pace(is_ahead(training.samples, crew.images, self._plan.learn.reuse))
            self._note(crew, training)
            self._let_fall(fraction)
            if now_s - saved_s > SAVE_S:
                self._save()
                saved_s = now_s
            self._tell(crew, training, fraction)
            if training.ended or fraction >= LATE:
                return

    def _fraction(self, training: Training) -> float:
        """Share of the budget that is spent."""
        return self._plan.budget.share(self.minutes, training.samples)

    def _measure(self, crew: Crew, training: Training, background: "Background[Measured]", fraction: float) -> None:
        """Take a finished measurement, and measure the newest policy if it is due."""
        if (measured := background.result()) is not None:
            self._keep_if_best(measured)
            self._add_point(crew, training, measured.measurement)
        done = self.measurements
        offered, latest = training.offered, done[-1].fraction if done else 0.0
        due = fraction - latest >= self._plan.learn.val_every and not background.busy
        if offered is None or not due or fraction >= 1 or (done and done[-1].policy == offered.sha256):
            return
        seconds = self._plan.learn.val_share * (fraction - latest) / max(fraction, 1e-9) * self._spent_s
        episodes = episodes_to_measure(seconds, self._episode_s, VAL_EPISODES_MAX)

        def measure(check: Callable[[], None]) -> Measured:
            def report(name: str, record: EpisodeRecord) -> None:
                check()
                crew.show(name, offered.sha256, record)

            return self._measuring.val(offered.folder, offered.sha256, episodes, fraction, report=report)

        background.start(measure)

    def _keep_if_best(self, measured: Measured) -> None:
        """Copy a policy out of the candidates' folders, which are temporary, if it is the best so far."""
        self._episode_s = measured.episode_s
        rows = [*self.measurements, measured.measurement]
        if best_of(rows) == len(rows) - 1:
            keep_policy(measured.folder, self._plan.best)
        candidates = sorted(measured.folder.parent.iterdir())
        for folder in candidates[:-CANDIDATES]:
            shutil.rmtree(folder, ignore_errors=True)

    def _let_fall(self, fraction: float) -> None:
        """Begin the learning-rate decay at the end of the budget, or when nothing improves any more.

        The trainer counts processor time and the budget is wall time; a decay that begins after the share t of it takes
        d / (1 - d) of t, so that it ends with the budget if t = 1 - d.
        """
        if self._begun_decay:
            return
        by_time = self._plan.budget.samples is None and fraction >= 1 - decay_share()
        if by_time or has_stopped_rising(self.measurements, fraction, self._plan.learn.patience):
            begin_decay(self._plan.policy)
            self._begun_decay = True

    def _split_again(self, crew: Crew, training: Training) -> None:
        """Divide the cores by the measured rates of recording and training, once."""
        if self._reach.hosts or self._split is not None or 60 * training.minutes < SPLIT_S or not crew.collect_hz:
            return
        threads = crew.running.trainer_threads
        self._split = split_cores(
            available_cores(),
            scenes=len(self._plan.places),
            collect_hz=crew.collect_hz,
            train_hz=training.samples_hz / threads,
            reuse=self._plan.learn.reuse,
        )
        crew.split(self._split)
        self._save()

    def _note(self, crew: Crew, training: Training) -> None:
        """Add a point to the curve, `POINTS` times over the budget."""
        apart = self._plan.budget.minutes / POINTS
        if training.samples and (not self.points or self.minutes - self.points[-1].minutes >= apart):
            self._add_point(crew, training, None)

    def _add_point(self, crew: Crew, training: Training, measurement: PolicyMeasurement | None) -> None:
        point = CurvePoint(
            minutes=self.minutes,
            recorded=crew.images,
            learned=training.samples,
            policies=crew.policies,
            loss=training.loss,
            driven=training.driven,
            measurement=measurement,
        )
        self.points.append(point)
        # Save the time first: a run that resumes after a kill is never earlier than its curve.
        self._save()
        save_curve(self._plan.curve_file, self.points)

    def _tell(self, crew: Crew, training: Training, fraction: float) -> None:
        done = self.measurements
        now = Now(
            fraction=min(fraction, 1.0),
            minutes=self.minutes,
            samples=crew.samples,
            images=crew.images,
            learned=training.samples,
            policies=crew.policies,
            driven=training.driven,
            latest=done[-1] if done else None,
        )
        self._show(now)

    def _measure_last(self) -> None:
        """Measure the final policy, and leave the best policy as the run's."""
        plan = self._plan
        if not (plan.policy / SPEC_FILE).exists():
            raise RunError(
                f"Nothing was learned in {self.minutes:.1f} min: the trainer saw too few episodes; give more --minutes "
                f"(its log: {plan.out / 'logs' / 'trainer.log'})."
            )
        self._measure_now(plan.policy, VAL_EPISODES_MAX)
        self._leave_best(plan.policy)

    def take(self, folder: Path) -> PolicyMeasurement | None:
        """Measure a policy that learned from this run's data elsewhere, and leave the better one as the run's.

        Args:
            folder: Folder of the policy.

        Returns:
            The measurement of the policy that is kept.

        Raises:
            PolicyError: If the policy cannot be used.
        """
        if policy_sha256(folder) not in [measurement.policy for measurement in self.measurements]:
            self._measure_now(folder, TAKEN_EPISODES_MAX)
        self._leave_best(folder)
        return self._kept

    @property
    def _kept(self) -> PolicyMeasurement | None:
        """The best measurement so far; None without measurements."""
        best = best_of(self.measurements)
        return None if best is None else self.measurements[best]

    def _measure_now(self, folder: Path, episodes_max: int) -> None:
        """Measure a policy at the end of the budget."""
        training, share_s = read_training(self._plan.policy), self._plan.learn.val_share * self._spent_s
        episodes = episodes_to_measure(share_s, self._episode_s, episodes_max)
        measured = self._measuring.val(folder, policy_sha256(folder), episodes, 1.0)
        before = self.points[-1] if self.points else None
        self.points.append(
            CurvePoint(
                # The state has the time in tenths of a second: a resumed run may be a little earlier than its curve.
                minutes=max(self.minutes, before.minutes if before else 0.0),
                recorded=before.recorded if before else 0,
                learned=training.samples,
                policies=before.policies if before else 0,
                loss=training.loss,
                driven=training.driven,
                measurement=measured.measurement,
            )
        )
        save_curve(self._plan.curve_file, self.points)

    def _leave_best(self, folder: Path) -> None:
        """Leave the best policy as the run's: one that was measured before, or the one of a folder."""
        plan = self._plan
        if self._kept is not None and self._kept.policy == policy_sha256(folder):
            keep_policy(folder, plan.best)
        # policy.toml is written last: without it the folder is not a policy.
        (plan.policy / SPEC_FILE).unlink(missing_ok=True)
        for name in (WEIGHTS_FILE, *POLICY_FILES):
            write_whole(plan.policy / name, (plan.best / name).read_bytes(), raises=RunError)
        note_origin(plan.policy, origin_of_runs(place.spec for place in plan.places))

    def _save(self) -> None:
        split = {"split": section_to_mapping(self._split)} if self._split else {}
        budget = section_to_mapping(self._plan.budget)
        over = {"over": budget} if self._over else {}
        write_state(self._plan, spent_s=round(self._spent_s, 1), budget=budget, **split, **over)


def _of_budget(point: CurvePoint, budget: Budget) -> CurvePoint:
    """A point of a run that had another budget: its measurement with the share of this one that was spent."""
    if point.measurement is None:
        return point
    measurement = dataclasses.replace(point.measurement, fraction=budget.share(point.minutes, point.learned))
    return dataclasses.replace(point, measurement=measurement)


def keep_policy(folder: Path, kept: Path) -> None:
    """Copy a policy atomically: `kept` holds either the new or the previous policy."""
    with unfinished_folder(kept, good=lambda: False, raises=RunError) as place:
        for name in (WEIGHTS_FILE, *POLICY_FILES):
            shutil.copyfile(folder / name, place / name)
