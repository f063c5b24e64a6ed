"""From a model to the settings to use: baseline, search, contenders, the written model, proof."""

import json
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import mujoco

from contactlab.contact.trace_arrays import Floats
from contactlab.errors import ExpectationError, SceneError, StoppedError, SweepFileError
from contactlab.run.evidence_record import as_written, engine, provenance
from contactlab.scene.compile_model import PREFIX
from contactlab.scene.model_writer import ModelEdits, WrittenModel, write_model
from contactlab.scene.scene import Scene
from contactlab.schema.coverage import Exercised
from contactlab.schema.drive import drive_data, drive_text
from contactlab.schema.tune_report import (
    MODEL,
    PATCH,
    PROOF,
    REPORT,
    Candidate,
    Changed,
    Kept,
    Line,
    Proof,
    Standing,
    TuneReport,
)
from contactlab.store.finished_store import Store
from contactlab.studies.configuration_runs import ConfigurationRows, Row
from contactlab.studies.effects.metric_changes import difference
from contactlab.studies.session import Session, Values
from contactlab.studies.tune.knobs import space_of
from contactlab.studies.tune.savers import untouched_geoms
from contactlab.studies.tune.search import GAIN, Search, Space
from contactlab.studies.tune.trials import (
    ACCURACY,
    PRUNING,
    Contender,
    Limits,
    OutOfTimeError,
    Trials,
)
from contactlab.studies.tune.tune_request import BASELINE, CONTENDERS, FRESH, TuneRequest

_LEAST_ERROR = 1e-6
"""Errors up to this count as none [m]."""
_CHAOTIC = 2.0
"""How much farther than a nudged start a configuration may part, where that is too far already."""
_SAFE = 0.8
"""Largest share of its limits that the safer choice takes."""


def run(request: TuneRequest, session: Session) -> TuneReport:
    """Search for better settings, write the model that has them, and prove it from fresh seeds.

    The folder receives `tune.json`; if something is recommended, also the model, a patch, and a
    sweep that repeats the proof.

    Raises:
        SceneError: there is no such model, or it does not compile.
        SweepFileError: a tolerance names no metric, or the budget is too short for a proof.
        ExpectationError: runs of the model as written fail.
        OutputError: the folder cannot be written, or has another model's results.
        StoppedError: the session was stopped before there was anything to prove.
    """
    session = replace(session, folder=session.folder.resolve())
    session.claim("tune", request.model)
    study = _begun(request, session)
    study.save()
    search = study.search()
    study.compare(search)
    recommended = study.prove()
    report = study.report(recommended)
    session.write({REPORT: report.model_dump_json(indent=2) + "\n"})
    return report


@dataclass
class _Study:
    """One model, what its runs as written showed, and what was found since.

    Attributes:
        seed_seconds: wall time that one seed of the model as written took.
        now: the model as written, from the seeds of the contenders once there are any.
        savers: what may go without changing a run.
        lighter: the scene without that.
        contenders: those that are feasible and cheaper, the one to recommend first.
    """

    request: TuneRequest
    session: Session
    trials: Trials
    space: Space
    kept: list[Kept]
    seed_seconds: float
    now: Contender
    savers: ModelEdits
    lighter: Scene
    ended: str = ""
    tried: int = 0
    contenders: list[Contender] = field(default_factory=list[Contender])
    proof: Proof | None = None

    def save(self) -> None:
        """Leave out what changes no run: the model without it must move bit for bit the same."""
        scene, name = self.trials.setup.scene, "untouched"
        edits = savers_of(scene, [row["qpos"] for row in self.now.rows.flat], self.request)
        if edits == self.savers:
            return
        try:
            written = write_model(scene, edits, self.session.folder / name, MODEL)
            rows = self.trials.run_file(f"{name}-runs", written.source, BASELINE)
        except SceneError as error:
            self.kept.append(Kept(name="geoms that never touch", reason=str(error)))
            return
        if _same_runs(self.now.rows, rows) < len(BASELINE):
            self.kept.append(Kept(name="geoms that never touch", reason="runs differ without them"))
            return
        self.savers, self.lighter = edits, self.trials.scene_of(written.source)

    def search(self) -> Search:
        """Search for as long as the budget lasts, less what contenders and proof will take."""
        trials, search = self.trials, Search(self.space, self._judge, self._clock)
        last = trials.deadline
        trials.deadline -= (len(FRESH) + len(BASELINE)) * self.seed_seconds
        try:
            search.run()
            if self.request.goal == "most-accurate":
                search.sharpen()
        except OutOfTimeError:
            self.ended = f"after {self.request.budget:g} s"
        except StoppedError:
            self.ended = "when it was interrupted"
            self.session = trials.session = replace(self.session, stop=None)
        trials.deadline, self.tried = last, len(search.excess)
        return search

    def _judge(self, configurations: Sequence[Values]) -> list[float]:
        self._say(f"judging {len(configurations)} configurations")
        self.tried += len(configurations)
        return self.trials.judge([self._changed(each) for each in configurations])

    def _clock(self, configurations: Sequence[Values]) -> list[float]:
        self._say(f"timing {len(configurations)} configurations")
        timed = [(self.lighter, self._changed(each)) for each in configurations]
        return [cost.ratio for cost in self.trials.costs(timed, BASELINE[:1])]

    def _say(self, doing: str) -> None:
        left = self.trials.deadline - time.monotonic()
        self.session.notify(f"{doing}; {self.tried} so far, {max(left, 0):.0f} s left")

    def _changed(self, values: Values) -> Values:
        written = self.space.written
        return {name: value for name, value in values.items() if value != written[name]}

    def compare(self, search: Search) -> None:
        """Run what was found, and the same with shorter steps, from as many seeds as time allows.

        The best comes first.
        """
        found = [search.here]
        if self._changed(search.here):
            found += [search.longer(rungs) for rungs in (-1, -2)]
        changes = [self._changed(each) for each in found]
        distinct = list({json.dumps(each, default=str): each for each in changes}.values())
        left = self.trials.deadline - time.monotonic() - len(FRESH) * self.seed_seconds
        seeds = CONTENDERS[: max(len(BASELINE), int(left / self.seed_seconds))]
        self._say(f"comparing {len(distinct)} configurations from {len(seeds)} seeds")
        now, *rows = self.trials.run("contenders", [{}, *distinct], seeds, accuracy=PRUNING)
        self.now, self.trials.limits = Contender({}, now), limits_of(self.request, now)
        costs = self.trials.costs([(self.lighter, each) for each in distinct])
        compared = map(Contender, distinct, rows, costs)
        self.contenders = sorted(filter(self._is_better, compared), key=self._rank)

    def _is_better(self, contender: Contender) -> bool:
        why = self._broken(contender.rows, self.now.rows)
        ratio = contender.cost.ratio if contender.cost else math.inf
        if not why and ratio > (1.0 if self.request.goal == "most-accurate" else GAIN):
            why = f"takes {ratio:.2f} times as long"
        if why:
            self._keep(contender, why)
        return not why

    def _broken(self, rows: ConfigurationRows, now: ConfigurationRows) -> str:
        """Say why runs are not as good as those of the model as written; empty if they are."""
        limits = self.trials.limits
        if why := limits.broken(rows):
            return why
        change = difference({}, now, rows)
        return change.reason if limits.chaotic and change.matters else ""

    def _keep(self, contender: Contender, reason: str) -> None:
        name = settings_text(contender.changed) or "as written"
        self.kept.append(Kept(name=name, reason=reason))

    def _rank(self, contender: Contender) -> float:
        """Return what is to be small: the time or, for the most accurate, the error."""
        if self.request.goal == "most-accurate" or contender.cost is None:
            return self.trials.limits.excess(contender.rows)
        return contender.cost.ratio

    def prove(self) -> tuple[Contender, WrittenModel] | None:
        """Write contenders, the best first, until one holds from fresh seeds; return that."""
        for each in self.contenders:
            try:
                edits = replace(self.savers, settings=each.changed)
                folder = self.session.folder / "tuned"
                written = write_model(self.trials.setup.scene, edits, folder, MODEL)
            except SceneError as error:
                self._keep(each, str(error))
                continue
            self.proof = self._proof(each, written)
            if self.proof.holds:
                return each, written
            self._keep(each, f"in fresh runs, {self.proof.reason}")
        return None

    def _proof(self, contender: Contender, written: WrittenModel) -> Proof:
        """Run the settings, and the file that has them, from fresh seeds beside the model."""
        self._say(f"proving it from {len(FRESH)} fresh seeds")
        both = [{}, contender.changed]
        now, rows = self.trials.run("proof", both, FRESH, accuracy=dict(ACCURACY))
        file = self.trials.run_file("tuned-runs", written.source, FRESH)
        (cost,) = self.trials.costs([(self.trials.scene_of(written.source), {})])
        limits = self.trials.limits = limits_of(self.request, now)
        why = self._broken(rows, now) or limits.failed(file)
        most = 1.0 if self.request.goal == "most-accurate" else GAIN
        if not why and cost.ratio > most:
            why = f"takes {cost.ratio:.2f} times as long"
        return Proof(
            seeds=tuple(FRESH),
            holds=not why,
            reason=why or "every run is within the limits",
            same_runs=_same_runs(rows, file),
            now=Contender({}, now).reported("now", self.trials),
            tuned=replace(contender, rows=rows, cost=cost).reported("recommended", self.trials),
        )

    def report(self, found: tuple[Contender, WrittenModel] | None) -> TuneReport:
        """Return the report, and write patch and sweep of what is recommended."""
        scene, setup, trials = self.trials.setup.scene, self.trials.setup, self.trials
        chosen, written = found or (None, None)
        changed = chosen.changed if chosen else {}
        if written:
            self.session.write({PATCH: written.patch.decode(), PROOF: self._proof_sweep(changed)})
        return TuneReport(
            model=self.request.model,
            scene_hash=scene.hash,
            goal=self.request.goal,
            drive=drive_text(scene.drive.drive),
            duration=setup.duration or scene.duration,
            limits=dict(trials.limits.sizes),
            asked=self.request.error is not None,
            divergence=trials.limits.divergence,
            engine=engine(),
            provenance=provenance(),
            candidates=self._candidates(chosen),
            changes=tuple(
                Changed(
                    name=name, before=as_written(self.space.written[name]), after=as_written(to)
                )
                for name, to in changed.items()
            ),
            kept=tuple(self.kept),
            proof=self.proof,
            file=str(written.path.relative_to(self.session.folder)) if written else None,
            lines=tuple(Line(**vars(each)) for each in written.changes) if written else (),
            ended=self.ended,
            tried=self.tried,
            runs=trials.runs,
            stores=tuple(trials.stores),
        )

    def _candidates(self, chosen: Contender | None) -> tuple[Candidate, ...]:
        """Return the model as written, what is recommended, and what is safer or more accurate."""
        excess = self.trials.limits.excess
        rows: list[tuple[Standing, Contender]] = [("now", self.now)]
        if chosen:
            rows.append(("recommended", chosen))
        others = [each for each in self.contenders if each is not chosen] if chosen else []
        safe = [each for each in others if excess(each.rows) <= _SAFE]
        if chosen and safe and excess(chosen.rows) > _SAFE:
            rows.append(("safer", safe[0]))
        best = min(others, key=lambda each: excess(each.rows), default=chosen)
        if chosen and best and excess(best.rows) < excess(chosen.rows) and best is not rows[-1][1]:
            rows.append(("more accurate", best))
        return tuple(each.reported(standing, self.trials) for standing, each in rows)

    def _proof_sweep(self, changed: Values) -> str:
        """Return a sweep that runs the settings beside the model as written, from fresh seeds."""
        setup, limits = self.trials.setup, self.trials.limits
        path = Path(setup.reference)
        scene = setup.scene
        content = {
            "version": 1,
            "scene": str(path.resolve()) if path.exists() else setup.reference,
            "description": f"What `contactlab tune` recommends for {setup.reference}",
            "duration": setup.duration or scene.duration,
            "drive": drive_data(scene.drive.drive),
            "seeds": [each + len(FRESH) for each in FRESH],
            "axes": {name: [as_written(value)] for name, value in changed.items()},
            "effects": "all",
            "baseline": True,
            "accuracy": dict(ACCURACY),
            "timing": {"rounds": 3},
            "tolerances": dict(limits.sizes),
            "expect": [{"label": sorted(limits.labels)}],
            "trace": "none",
        }
        # JSON is YAML, too.
        return json.dumps(content, indent=2) + "\n"


def _begun(request: TuneRequest, session: Session) -> _Study:
    """Run the model as written, and see what its runs allow to say."""
    begin, setup = time.monotonic(), request.setup
    trials = Trials(setup, session, begin + request.budget)
    session.notify(f"running {request.model} as written")
    (now,) = trials.run("baseline", [{}], BASELINE, measure=_motion, accuracy=PRUNING, trace="all")
    trials.limits = limits_of(request, now)
    spent = time.monotonic() - begin
    proof_seconds = spent / len(BASELINE) * len(FRESH)
    if spent + proof_seconds > request.budget:
        minutes = max(1, round(4 * (spent + proof_seconds) / 60))
        raise SweepFileError(
            f"--budget {request.budget:g}s is too short: {len(BASELINE)} runs of the model as "
            f"written took {spent:.0f} s, and a proof takes {proof_seconds:.0f} s; write --budget "
            f"{minutes}min"
        )
    space, kept = space_of(setup, Exercised.of(now.flat), request.free)
    per_seed, scene = spent / len(BASELINE), setup.scene
    baseline = Contender({}, now)
    return _Study(request, session, trials, space, kept, per_seed, baseline, ModelEdits(), scene)


def _motion(store: Store, run: str, _model: mujoco.MjModel) -> Row:
    return {"qpos": store.trace(run).qpos}


def _same_runs(one: ConfigurationRows, other: ConfigurationRows) -> int:
    """Return how many runs of the same seeds are the same bit for bit."""
    pairs = zip(one.flat, other.flat, strict=True)
    return sum(first["trajectory_hash"] == second["trajectory_hash"] for first, second in pairs)


def savers_of(scene: Scene, motion: Sequence[Floats], request: TuneRequest) -> ModelEdits:
    """Return what a model may be without: collisions that never happen, and sensors on request."""
    model = scene.base({}).model
    untouched = untouched_geoms(model, motion)
    names = (model.sensor(each).name for each in range(model.nsensor * request.drop_sensors))
    return ModelEdits(
        masked=untouched.masked,
        excluded=untouched.excluded,
        sensors=tuple(each for each in names if not each.startswith(PREFIX)),
    )


def limits_of(request: TuneRequest, now: ConfigurationRows) -> Limits:
    """Return what configurations must keep, from what runs of the model as written do."""
    for row in now.flat:
        if row["error_peak"] is None:
            raise ExpectationError(
                f"{request.model} as written ends as {row['label']} ({row['label_reason']}), so "
                f"there is nothing to compare with; contactlab check {request.model} says more"
            )
    own = max(_LEAST_ERROR, *(row["error_peak"] for row in now.flat))
    error = own if request.error is None else request.error
    divergence = max(row["divergence"] or 0.0 for row in now.flat)
    chaotic = divergence > error
    return Limits(
        sizes={"error_peak": _CHAOTIC * divergence if chaotic else error, **request.tolerances},
        labels=frozenset({"stable", *(row["label"] for row in now.flat)}),
        divergence=divergence,
        chaotic=chaotic,
    )


def settings_text(values: Values) -> str:
    """Return settings in a line."""
    return ", ".join(f"{name} {as_written(value)}" for name, value in values.items())
