"""From a model to the settings to use: baseline, search, contenders, the written model, proof."""

import json
import time
from dataclasses import replace
from pathlib import Path

from contactlab.errors import SweepFileError
from contactlab.run.evidence_record import engine, provenance
from contactlab.scene.model_writer import ModelEdits, WrittenModel
from contactlab.schema.coverage import Exercised
from contactlab.schema.drive import drive_data, drive_text
from contactlab.schema.study_reports import (
    PROOF,
    REPORT,
    Candidate,
    Changed,
    Line,
    Standing,
    TuneReport,
)
from contactlab.schema.tradeoff_report import REALITY
from contactlab.store.table_layout import as_written
from contactlab.studies.configuration_runs import sweep_of
from contactlab.studies.session import Session, Values
from contactlab.studies.tune.knobs import space_of
from contactlab.studies.tune.study import Study, motion_of
from contactlab.studies.tune.trials import PROVING, PRUNING, Contender, Trials
from contactlab.studies.tune.tune_request import BASELINE, FRESH, TuneRequest, by_seeds, limits_of

_SAFE = 0.8  # largest share of its limits that the safer choice takes


def run(request: TuneRequest, session: Session) -> TuneReport:
    """Search for better settings, write the model that has them, and prove it from fresh seeds.

    The folder receives `tune.json`; if something is recommended, also the model, a patch, and a
    sweep that repeats the proof. Raises a SceneError if there is no such model, or it does not
    compile; a SweepFileError if a tolerance names no metric, or the budget is too short for a
    proof; an ExpectationError if runs of the model as written fail; an OutputError if the folder
    cannot be written, or has another model's results; a StoppedError if the session was stopped
    before there was anything to prove.
    """
    session, _ = replace(session, folder=session.folder.resolve()), request.setup
    session.claim("tune", request.model)
    study = _begun(request, session)
    study.save()
    search = study.search()
    study.compare(search)
    recommended = study.prove()
    report = reported(study, recommended)
    session.write({REPORT: report.model_dump_json(indent=2) + "\n"})
    return report


def _begun(request: TuneRequest, session: Session) -> Study:
    """Run the model as written, and see what its runs allow to say."""
    begin, setup = time.monotonic(), request.setup
    trials = Trials(setup, session, begin + request.budget, error=request.error)
    session.notify(f"running {request.model} as written")
    (now,) = trials.run("baseline", [{}], BASELINE, measure=motion_of, refine=PRUNING, trace="all")
    trials.limits = limits_of(request, now)
    ((spent,),) = trials.once("baseline", lambda: [[time.monotonic() - begin]])
    proof_seconds = spent / len(BASELINE) * len(FRESH)
    if spent + proof_seconds > request.budget:
        minutes = max(1, round(4 * (spent + proof_seconds) / 60))
        raise SweepFileError(
            f"--budget {request.budget:g}s is too short: {len(BASELINE)} runs of the model as "
            f"written took {spent:.0f} s, and a proof takes {proof_seconds:.0f} s; write --budget "
            f"{minutes}min"
        )
    space, kept = space_of(setup, Exercised.of(now.flat), request.free)
    per_seed, baseline = spent / len(BASELINE), Contender({}, now)
    return Study(request, session, trials, space, kept, per_seed, baseline, ModelEdits(), setup)


def reported(study: Study, found: tuple[Contender, WrittenModel] | None) -> TuneReport:
    """Return the report, and write patch and sweep of what is recommended."""
    scene, setup, trials = study.trials.setup.scene, study.trials.setup, study.trials
    chosen, written = found or (None, None)
    changed = chosen.changed if chosen else {}
    if written:
        study.session.write({PROOF: _proof_sweep(study, changed)})
    return TuneReport(
        model=study.request.model,
        scene_hash=scene.hash,
        goal=study.request.goal,
        task=setup.task,
        drive=drive_text(scene.drive.drive),
        duration=setup.duration or scene.duration,
        limits=dict(trials.limits.sizes),
        asked=study.request.error not in (None, REALITY),
        divergence=trials.limits.divergence,
        engine=engine(),
        provenance=provenance(),
        candidates=_candidates(study, chosen),
        changes=tuple(
            Changed(name=name, before=as_written(study.space.written[name]), after=as_written(to))
            for name, to in changed.items()
        ),
        masked=study.savers.masked,
        excluded=study.savers.excluded,
        sensors=study.savers.sensors,
        profile=trials.profile(),
        kept=tuple(study.kept),
        proof=study.proof,
        file=str(written.path.relative_to(study.session.folder)) if written else None,
        lines=tuple(Line(**vars(change)) for change in written.changes) if written else (),
        ended=study.ended,
        tried=study.tried,
        runs=trials.runs,
        stores=tuple(trials.stores),
    )


def _candidates(study: Study, chosen: Contender | None) -> tuple[Candidate, ...]:
    """Return the model as written, what is recommended, and what is safer or more accurate."""
    excess = study.trials.limits.excess
    if not chosen:
        return (study.now.reported("now", study.trials),)
    rows: list[tuple[Standing, Contender]] = [("now", study.now), ("recommended", chosen)]
    others = [contender for contender in study.contenders if contender is not chosen]
    safe = [other for other in others if excess(other.rows) <= _SAFE]
    if safe and excess(chosen.rows) > _SAFE:
        rows.append(("safer", safe[0]))
    best = min([chosen, *others], key=lambda contender: excess(contender.rows))
    if all(best is not contender for _, contender in rows):
        rows.append(("more accurate", best))
    return tuple(contender.reported(standing, study.trials) for standing, contender in rows)


def _proof_sweep(study: Study, changed: Values) -> str:
    """Return a sweep that runs the settings beside the model as written, from fresh seeds."""
    setup, trials = study.trials.setup, study.trials
    path, rows = Path(setup.reference), [{}, changed]
    reference = str(path.resolve()) if path.exists() else setup.reference
    seeds = tuple(seed + len(FRESH) for seed in FRESH)
    asked: dict[str, object] = {
        "description": f"What `contactlab tune` recommends for {setup.reference}",
        "drive": drive_data(setup.scene.drive.drive),
        "accuracy": None if trials.error == REALITY else trials.accuracy(PROVING),
        "timing": {"rounds": 3},
        "tolerances": dict(trials.limits.sizes),
        "expect": [{"label": sorted(trials.limits.labels)}],
        "trace": "none",
    }
    setup = by_seeds(replace(setup, reference=reference), seeds, trials.error)
    sweep = sweep_of(setup, rows, asked)
    # JSON is YAML, too.
    return json.dumps(sweep, indent=2) + "\n"
