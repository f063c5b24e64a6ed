"""One model that is tuned: what may go, the search, the comparison, the proof."""

import json
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import mujoco

from contactlab.errors import SceneError, StoppedError
from contactlab.scene.model_writer import ModelEdits, WrittenModel, write_model
from contactlab.schema.study_reports import MODEL, Kept, Proof, Ratio
from contactlab.store.finished_store import Store
from contactlab.store.table_layout import as_written
from contactlab.studies.configuration_runs import ConfigurationRows, Row
from contactlab.studies.effects.effects_request import AblationSetup
from contactlab.studies.session import Session, Values
from contactlab.studies.tune.profile import sensors_of, untouched_geoms
from contactlab.studies.tune.search import GAIN, Search, Space, key_of
from contactlab.studies.tune.trials import (
    PROVING,
    PRUNING,
    SHORT_TURN,
    Contender,
    OutOfTimeError,
    Trials,
)
from contactlab.studies.tune.tune_request import BASELINE, CONTENDERS, FRESH, TuneRequest, limits_of

COMPARED = "contenders"  # the store of what the search found, beside the model as written
_NEVER = "without collisions that never happen, and sensors if asked"


@dataclass
class Study:
    """One model, what its runs as written showed, and what was found since."""

    request: TuneRequest
    session: Session
    trials: Trials
    space: Space
    kept: list[Kept]
    seed_seconds: float  # wall time that one seed of the model as written took
    now: Contender  # the model as written, from the seeds of the contenders once there are any
    savers: ModelEdits  # what may go without changing a run
    lighter: AblationSetup  # the model without that
    ended: str = ""
    tried: int = 0
    # Those that are feasible and cheaper, the one to recommend first.
    contenders: list[Contender] = field(default_factory=list[Contender])
    proof: Proof | None = None

    def save(self) -> None:
        """Leave out what changes no run: the model without it must move bit for bit the same."""
        setup, name = self.trials.setup, "untouched"
        scene, varied = setup.scene, {*setup.base, *setup.scenarios[0]}
        model, manifest = scene.base({}).model, scene.source.manifest
        if manifest and varied & manifest.structure.keys():
            self.kept.append(Kept(name=_NEVER, reason="the sweep changes the bodies"))
            return
        edits = untouched_geoms(model, [row["qpos"] for row in self.now.rows.flat])
        if self.request.drop_sensors:
            edits = replace(edits, sensors=sensors_of(model))
        elif sensors_of(model):
            reason = "no metric reads them; --drop-sensors leaves them out"
            self.kept.append(Kept(name="sensors", reason=reason))
        if edits == self.savers:
            return
        try:
            written = write_model(scene, edits, self.session.folder / name, MODEL)
            lighter = self.trials.setup.written(written.reference, {})
            (rows,) = self.trials.run(f"{name}-runs", [{}], BASELINE, setup=lighter)
        except SceneError as error:
            self.kept.append(Kept(name=_NEVER, reason=str(error)))
            return
        if _same_runs(self.now.rows, rows) < len(rows.flat):
            self.kept.append(Kept(name=_NEVER, reason="runs differ"))
            return
        self.savers, self.lighter = edits, lighter

    def search(self) -> Search:
        """Search for as long as the budget lasts, less what contenders and proof will take."""
        trials, search = self.trials, Search(self.space, self._judge, self._clock)
        # It ran already.
        search.excess[key_of(self.space.written)] = trials.limits.excess(self.now.rows)
        last = trials.deadline
        trials.deadline -= (len(FRESH) + len(BASELINE)) * self.seed_seconds
        try:
            search.run()
            if self.request.goal == "most-accurate":
                search.sharpen()
        except OutOfTimeError:
            self.ended = f"after {self.request.budget:g} s"
        except (StoppedError, KeyboardInterrupt):
            self.ended = "when it was interrupted"
            self.session = trials.session = replace(self.session, stop=None)
        trials.deadline, self.tried = last, len(search.excess)
        why = trials.limits.broken(self.now.rows, self.now.rows)
        if why and not self._changed(search.here):
            self.kept.append(Kept(name="as written", reason=f"{why}, and nothing tried keeps it"))
        return search

    def _judge(self, configurations: Sequence[Values]) -> list[float]:
        self._say(f"judging {len(configurations)} configurations")
        self.tried += len(configurations)
        return self.trials.judge([self._changed(configuration) for configuration in configurations])

    def _clock(self, configurations: Sequence[Values]) -> list[float]:
        self._say(f"timing {len(configurations)} configurations")
        timed = [(self.lighter, self._changed(configuration)) for configuration in configurations]
        return [cost.ratio for cost in self.trials.costs(timed, BASELINE[:1], SHORT_TURN)]

    def _say(self, doing: str) -> None:
        left = self.trials.deadline - time.monotonic()
        self.session.notify(f"{doing}; {self.tried} so far, {max(left, 0):.0f} s left")

    def _changed(self, values: Values) -> Values:
        written = self.space.written
        return {name: value for name, value in values.items() if value != written[name]}

    def compare(self, search: Search) -> None:
        """Run what was found, from as many seeds as time allows, and the same with other steps.

        Shorter ones, as one seed may be lucky; longer ones of the most accurate, which may take
        longer than now; and the model's own, with its integrator. The best comes first.
        """
        others = (1, 2) if self.request.goal == "most-accurate" else (-1, -2)
        own = {name: self.space.written[name] for name in ("timestep", "integrator")}
        found = [search.here, *map(search.longer, others), {**search.here, **own}]
        changes = [self._changed(settings) for settings in found if self._changed(search.here)]
        changes = [change for change in changes if change] + [{}] * (self.savers != ModelEdits())
        distinct = list({json.dumps(change, default=str): change for change in changes}.values())
        if not distinct:
            return
        left = self.trials.deadline - time.monotonic() - len(FRESH) * self.seed_seconds
        seeds = CONTENDERS[: max(len(BASELINE), int(left / self.seed_seconds))]
        self._say(f"comparing {len(distinct)} configurations from {len(seeds)} seeds")
        every = [{}, *distinct]
        now, *rows = self.trials.run(COMPARED, every, seeds, refine=PRUNING, baseline=True)
        self.now, self.trials.limits = Contender({}, now), limits_of(self.request, now)
        costs = self.trials.costs([(self.lighter, settings) for settings in distinct])
        compared = map(Contender, distinct, rows, costs)
        self.contenders = sorted(filter(self._is_better, compared), key=self._rank)

    def _is_better(self, contender: Contender) -> bool:
        # What changes no run is as good as the model as written, however good that is.
        limits = self.trials.limits
        why = limits.broken(contender.rows, self.now.rows) if contender.changed else ""
        if why := why or self._slow(contender.cost):
            self._keep(contender, why)
        return not why

    def _slow(self, cost: Ratio | None) -> str:
        ratio = cost.ratio if cost else math.inf
        most = 1.0 if self.request.goal == "most-accurate" else GAIN
        return f"a simulated second costs {ratio:.2f} times as much" if ratio > most else ""

    def _keep(self, contender: Contender, reason: str) -> None:
        name = settings_text(contender.changed) or _NEVER
        self.kept.append(Kept(name=name, reason=reason))

    def _rank(self, contender: Contender) -> float:
        """Return what is to be small: the time or, for the most accurate, the error."""
        if self.request.goal == "most-accurate" or contender.cost is None:
            return self.trials.limits.excess(contender.rows)
        return contender.cost.ratio

    def prove(self) -> tuple[Contender, WrittenModel] | None:
        """Write contenders, the best first, until one holds from fresh seeds; return that."""
        for contender in self.contenders:
            try:
                edits = replace(self.savers, settings=contender.changed)
                folder = self.session.folder / "tuned"
                written = write_model(self.trials.setup.scene, edits, folder, MODEL)
            except SceneError as error:
                self._keep(contender, str(error))
                continue
            self.proof = self._proof(contender, written)
            if self.proof.holds:
                return contender, written
            self._keep(contender, f"in fresh runs, {self.proof.reason}")
        return None

    def _proof(self, contender: Contender, written: WrittenModel) -> Proof:
        """Run the settings, and the file that has them, from fresh seeds beside the model."""
        self._say(f"proving it from {len(FRESH)} fresh seeds")
        both = [{}, contender.changed]
        now, rows = self.trials.run("proof", both, FRESH, refine=PROVING)
        setup = self.trials.setup.written(written.reference, contender.changed)
        (file,) = self.trials.run("tuned-runs", [{}], FRESH, setup=setup)
        (cost,) = self.trials.costs([(setup, {})], FRESH)
        trials = replace(self.trials, limits=limits_of(self.request, now))
        why = trials.limits.broken(rows, now) if contender.changed else ""
        same = _same_runs(rows, file)
        if not why and same < len(file.flat):
            why = f"{len(file.flat) - same} runs of the file are others than those of the settings"
        why = why or self._slow(cost)
        return Proof(
            seeds=tuple(FRESH),
            holds=not why,
            reason=why or "every run is within the limits",
            same_runs=same,
            now=Contender({}, now).reported("now", trials),
            tuned=replace(contender, rows=rows, cost=cost).reported("recommended", trials),
        )


def motion_of(store: Store, run: str, _model: mujoco.MjModel) -> Row:
    """Return the configurations (T, nq) of a stored run."""
    return {"qpos": store.trace(run).qpos}


def _same_runs(one: ConfigurationRows, other: ConfigurationRows) -> int:
    """Return how many runs of the same seeds are the same bit for bit."""
    pairs = zip(one.flat, other.flat, strict=True)
    return sum(first["trajectory_hash"] == second["trajectory_hash"] for first, second in pairs)


def settings_text(values: Values) -> str:
    """Return settings in a line."""
    return ", ".join(f"{name} {as_written(value)}" for name, value in values.items())
