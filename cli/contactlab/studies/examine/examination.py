"""Examines a model under its task: runs and labels, budget and verdict, checks, and fixes.

Each part of the report is a section that may be requested alone, with the same numbers.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

from contactlab.budget import (
    Motion,
    Settings,
    Trial,
    budget_report,
)
from contactlab.budget.counted_time import WorkLimit
from contactlab.closed_loop.loop_margins import LoopStudy
from contactlab.errors import SweepFileError
from contactlab.judge.waivers import unused_waivers
from contactlab.modifications.numerics import CONVERGED_SOLVER
from contactlab.plan.task_options import AS_INFERRED, TaskOptions
from contactlab.printable import first_names
from contactlab.scene.model_writer import refuse_place, write_model
from contactlab.scene.mujoco_versions import VERSION
from contactlab.schema.coverage import ExercisedFeatures
from contactlab.schema.drive import PolicyDrive
from contactlab.schema.evidence import EvidenceRecord
from contactlab.schema.examination import (
    MOST_FIXES,
    Cause,
    Examination,
    Fix,
    RunLabel,
    SectionName,
)
from contactlab.schema.finding import Waiver
from contactlab.schema.grip import GripReport
from contactlab.schema.task import QPOS0
from contactlab.schema.verdict import PASSING_VERDICTS
from contactlab.schema.verification import VerifiedChange
from contactlab.store.table_layout import record_to_row
from contactlab.studies.check.check_entries import CHECKS, Check
from contactlab.studies.check.chosen_checks import chosen_checks, judged_findings
from contactlab.studies.check.own_runs import describe_reference
from contactlab.studies.examine.conclusion import conclude, find_failed_checks
from contactlab.studies.examine.contact_values import measure_contacts, split_values
from contactlab.studies.examine.departures import list_departures
from contactlab.studies.examine.design_causes import (
    find_lost_grip,
    find_overrun_stop,
    find_sagging_servo,
)
from contactlab.studies.examine.engine_faults import MetFaults
from contactlab.studies.examine.facts import (
    explain_depth,
    list_facts,
    list_inertia_facts,
    list_run_notes,
)
from contactlab.studies.examine.field_passages import judge_fields
from contactlab.studies.examine.fixes import FixSearch, RepairedFiles, TaskRepeats
from contactlab.studies.examine.judged_model import (
    BUDGETING,
    MAX_CPU,
    JudgedModel,
    list_begins,
    settle_task,
)
from contactlab.studies.examine.linted_file import lint_file
from contactlab.studies.examine.policy_loop import (
    list_loop_facts,
    make_loop_study,
    measure_loop,
)
from contactlab.studies.examine.repaired_causes import (
    CauseRepairer,
    RepairedModel,
    add_lost_loop,
    find_fall_through,
    find_fallen_start,
    list_file_causes,
    list_open_causes,
)
from contactlab.studies.examine.resting_contacts import resting_contacts
from contactlab.studies.examine.servo_table import (
    judge_loops,
    list_sagging_servos,
    list_unheld_servos,
    measure_task_servos,
)
from contactlab.studies.examine.standing_starts import list_falls, list_free_falls
from contactlab.studies.examine.undone_designs import (
    TaskEnds,
    list_idle_facts,
    list_undone_designs,
)
from contactlab.studies.examine.verified_fixes import FixVerifier
from contactlab.studies.grip.grip_fact import describe_grip, find_grip
from contactlab.studies.grip.grip_fixes import Grip
from contactlab.studies.verification import VerificationRequest, verify_change
from contactlab.tasks.checked_model import CheckedModel, open_changed_model, open_model
from contactlab.tasks.session import Session, Values
from contactlab.tasks.task_motions import Change, with_new_seeds
from contactlab.tasks.task_verdict import run_labels
from contactlab.temporary_folders import temporary_folder

SECTIONS: tuple[SectionName, ...] = get_args(SectionName)
REFERENCE = "reference.json"
RESULTS = "examine"
"""Name of its folder among the results."""
_OF_MOTIONS = {"budget", "facts", "fixes", "servos", "loop"}
_NOT_JUDGED = {"contacts", "servos", "loop"}
"""Sections that need no verdict of the task."""
_OF_RUNS = {"labels", "checks", "contacts"}
SETTINGS = Settings(measures_time=True)
# Shares of its time. Later, no more fixes, and no more runs that verify a fix are begun.
_FIXING, _VERIFYING = 0.7, 0.9
_CHANGED = "changed"  # store of runs with a fix


@dataclass(frozen=True)
class ExamineRequest:
    """The model to examine, and the options.

    Attributes:
        model: a scene, its folder, a model file, or a robot.
        assign: settings, `NAME=VALUE` each; for the section of contacts alone also requested values
            of them, such as `depth_at_rest`.
        task: replacements for parts of the model's own task; its limits are of checks or labels,
            by name.
        sections: requested parts of the report.
        checks: names of checks; all if empty.
        accepted: findings of checks that are waived.
        write: file for the model with the first fix that keeps the model.
        apply: names of fixes that make another model, which are written too.
        max_cpu: counted time within which it ends [s], with the results until then.
        begins: called with the name of each part of the examination when it begins.
        film: called with the grip of the model as written, if the report has one.
    """

    model: str
    assign: Sequence[str] = ()
    task: TaskOptions = AS_INFERRED
    sections: tuple[SectionName, ...] = SECTIONS
    checks: Sequence[str] = ()
    accepted: Sequence[Waiver] = ()
    write: Path | None = None
    apply: Sequence[str] = ()
    max_cpu: float = MAX_CPU
    begins: Callable[[str], None] = lambda _: None
    film: Callable[[Grip], None] = lambda _: None

    @property
    def has_runs(self) -> bool:
        """Whether a requested section needs stored runs, as a page does."""
        return bool({*self.sections} & _OF_RUNS)

    @property
    def parts(self) -> int:
        """Largest number of its parts."""
        wanted = {*self.sections}
        measured = not wanted <= _NOT_JUDGED
        alone = ("checks" in wanted) + ("servos" in wanted) + ("loop" in wanted)
        parts = self.has_runs + alone + measured
        return parts + 2 * ("fixes" in wanted)


def examine_model(request: ExamineRequest, session: Session) -> Examination:
    """Examine a model; its runs are stored in the session's folder.

    Raises:
        SceneError: there is no such model, keyframe or body, or it does not compile.
        SweepFileError: a setting or the name of a check or limit is wrong, or the tolerance is not
            a share.
        EngineError: nothing moves, or another engine than MuJoCo is requested.
        PolicyError: a waiver names no finding of any check.
        OutputError: stores or the fixed model cannot be written.
        StoppedError: it was interrupted.
    """
    limit, wanted = WorkLimit(request.max_cpu), {*request.sections}
    checks = {name: CHECKS[name] for name in chosen_checks(request.checks)}
    judged_findings([], request.accepted)
    if request.apply and request.write is None:
        raise SweepFileError("--apply needs --write FILE")
    assign, values = split_values(request.assign)
    if wanted == {"contacts"}:
        return _measure_rest(request, assign, values, session)
    if values:
        raise SweepFileError(
            f"--set {next(iter(values))}=... needs --section contacts, which finds its solref"
        )
    examined, options, met, left_out = _open_examined(request, session)
    request, task = replace(request, task=options), examined.task
    session.claim(RESULTS, request.model)
    session.notify(f"examining {request.model}")
    report = Examination(
        model=request.model,
        mujoco=VERSION,
        task=task,
        sections=request.sections,
        not_tried=left_out,
    )
    if request.has_runs:
        request.begins("running its task")
        report = _run_task(report, examined)
    if "checks" in wanted:
        request.begins("checking it")
        report = _check_model(report, checks, examined, request.accepted)
    if "servos" in wanted and examined.moves:
        request.begins("measuring its servos")
        report = report.model_copy(update={"servos": measure_task_servos(examined.motions[0])})
    study = make_loop_study(examined) if "loop" in wanted and examined.moves else None
    if study is not None:
        request.begins("measuring the loop of its policy")
        report = report.model_copy(update={"loop": measure_loop(study)})
    if wanted <= _NOT_JUDGED:
        return judge_loops(report)
    with temporary_folder() as folder:
        return _measure_budget(request, report, examined, limit, Path(folder), study, met)


def _open_examined(request: ExamineRequest, session: Session) -> JudgedModel:
    wanted = {*request.sections}
    examined = _open_task(request, session)
    if request.write is not None:
        refuse_place(examined.scene.source, request.write.parent, request.write.name)
    if wanted & _OF_MOTIONS and not examined.moves:
        # It says why there are none, before anything is run.
        examined.motions_of(examined.task)
    if wanted <= _NOT_JUDGED or not examined.moves:
        return JudgedModel(examined, request.task)
    return settle_task(
        examined,
        lambda task: _open_task(replace(request, task=task), session),
        max_cpu=request.max_cpu,
        finds_faults=bool(wanted & {"facts", "fixes"}),
        avoids_faults="fixes" in wanted,
    )


def _open_task(request: ExamineRequest, session: Session) -> CheckedModel:
    return open_model(
        request.model,
        session,
        request.task,
        request.assign,
        rows=None if {*request.sections} & {"budget", "fixes"} else (),
        seconds=BUDGETING * request.max_cpu,
    )


def _measure_rest(
    request: ExamineRequest, assign: Sequence[str], values: Mapping[str, str], session: Session
) -> Examination:
    """Return a report of the contacts alone, with settings for any requested values."""

    def begin() -> None:
        session.claim(RESULTS, request.model)
        request.begins("running its task")

    examined, contacts, missed = measure_contacts(
        request.model, assign, values, session, request.task, begin
    )
    return Examination(
        model=request.model,
        mujoco=VERSION,
        task=examined.task,
        sections=request.sections,
        contacts=contacts,
        requested=tuple(values),
        missed=missed,
    )


def _run_task(report: Examination, examined: CheckedModel) -> Examination:
    if "contacts" in report.sections:
        contacts = tuple(resting_contacts(examined))
        report = report.model_copy(update={"contacts": contacts})
    if {*report.sections} <= _NOT_JUDGED:
        return report
    budget = examined.budget if examined.moves else None
    labels = tuple(
        label.model_copy(update={"reason": examined.name_geoms(label.reason)})
        for label in run_labels(report.task, [run.record for run in examined.runs], budget)
    )
    return report.model_copy(update={"task_verdict": examined.verdict, "labels": labels})


def _measure_budget(
    request: ExamineRequest,
    report: Examination,
    examined: CheckedModel,
    limit: WorkLimit,
    folder: Path,
    study: LoopStudy | None,
    met: MetFaults,
) -> Examination:
    """Return a report with its budget, facts, fixes and verdict.

    The limit began with the examination. The folder is for repaired models, and the study is that
    of the loop of a policy.
    """
    request.begins("measuring its error budget")
    if not examined.moves:
        return conclude(report)
    task, search, verifier = report.task, None, None
    file = lint_file(examined.scene.source, request.model, task.start)
    faults = [*file.faults]
    if not any(fault.stage == "start" or fault.is_of_start for fault in faults):
        faults += find_fallen_start(examined)
    faults += find_fall_through(examined)
    repaired = RepairedModel(examined, report.labels, tuple(list_file_causes(faults)))
    broken = next((fault.fix for fault in file.faults if fault.is_of_start), "")
    fixes, files = tuple[Fix, ...](), None
    times = list_begins(examined)
    if not broken:
        causes, broken = judge_fields(examined.motions, times, failing=not repaired.passes)
        repaired = replace(repaired, causes=(*repaired.causes, *causes))
    ends = TaskEnds(examined.motions[0])
    model = ends.model
    grip = None if request.assign else find_grip(request.model, model, task.start, request.film)
    is_known = bool(broken) or any(fault.is_certain for fault in faults)
    designs = () if is_known else tuple(_list_design_causes(examined, report.labels, grip, ends))
    repaired = replace(repaired, causes=(*repaired.causes, *designs))
    if "fixes" in request.sections and not broken:
        left = _limit_share(limit, _VERIFYING, examined)
        repairer = _make_repairer(request, examined, report, folder, left, meets_fault=met.acts)
        repaired = repairer.repair_model(report.labels, faults, tuple(find_failed_checks(report)))
        repaired = _repair_design(repairer, repaired, grip, designs)
        repaired = repairer.repair_loop(repaired, study, report.loop, request.apply)
        files = repairer.list_files(repaired)
        # A replay of a loop that does not hold misleads.
        searched = (report.loop is None or report.loop.holds) and not any(
            fault.stage == "file" for fault in repaired.faults
        )
        if searched and (not files or repaired.word not in PASSING_VERDICTS):
            verifier = FixVerifier(
                repaired.examined,
                repaired.examined.budget_verdict,
                repaired.labels,
                lambda file: open_changed_model(file, examined.session, request.task),
                _limit_share(limit, _VERIFYING, repaired.examined),
                frozenset(fault.rule for fault in faults if fault.stage == "numerics"),
            )
            search = _search_fixes(
                request, repaired, files, verifier, _limit_share(limit, _FIXING, examined)
            )
            fixes = verifier.recommend_fixes(search)
        if searched:
            repaired = repairer.repair_numerics(repaired, faults, names_only=bool(fixes))
            files = repairer.list_files(repaired)
        fixes = (*repaired.fixes, *fixes)
    repaired = add_lost_loop(repaired, report.loop)
    tried = search.tried if search else ()
    if "facts" in request.sections:
        found = [
            *met.facts,
            *list_falls(ends.motion, repaired.causes),
            *list_free_falls(model),
            *list_departures(ends.motion, task.start, repaired.causes),
            *explain_depth(list_facts(examined.motions, times), examined),
            *list_run_notes(examined),
            *list_inertia_facts(examined.prepared.model),
            *(() if designs else list_sagging_servos(report.servos)),
            *list_idle_facts(ends),
            *list_loop_facts(report.loop),
            *(list_unheld_servos(report.servos) if request.assign else ()),  # as lint has them
            *(() if grip is None else (describe_grip(grip),)),
            *(() if request.assign else file.facts),
        ]
        known = {cause.sentence for cause in repaired.causes}
        found = tuple(fact for fact in found if fact.sentence not in known)
        report = report.model_copy(update={"facts": found})
    skipped = tuple(search.not_tried) if search else ()
    report = report.model_copy(
        update={
            "budget": budget_report(examined.budget, examined.budget_verdict, tried),
            "causes": repaired.causes,
            "fixes": fixes,
            "rejected_fixes": (*repaired.rejected, *(verifier.rejected if verifier else ())),
            "not_tried": (*report.not_tried, *examined.unmeasured, *skipped),
        }
    )
    trials = len(tried) + search.label_trials if search else 0
    report = conclude(report, fixes_tried=trials, fixes_not_tried=skipped)
    return _write_result(
        request,
        examined,
        report.model_copy(update={"fix": broken or report.fix}),
        verifier,
        search,
        files,
    )


def _repair_design(
    repairer: CauseRepairer,
    repaired: RepairedModel,
    grip: GripReport | None,
    designs: Sequence[Cause],
) -> RepairedModel:
    if repaired.examined.task.start != QPOS0:
        repaired = repairer.join_grip(repaired)
    # Causes of the design of a repaired model are found in its own motions.
    if repaired.fixes and repaired.word not in PASSING_VERDICTS:
        examined = repaired.examined
        if grip is not None:
            model = examined.motions[0].model
            grip = find_grip(examined.reference, model, examined.task.start)
        ends = TaskEnds(examined.motions[0])
        designs = tuple(_list_design_causes(examined, repaired.labels, grip, ends))
    elif repaired.causes:
        designs = ()
    for cause in designs:
        if grip is not None and grip.keyframe and cause.sentence == describe_grip(grip).sentence:
            repaired = repairer.repair_grip(repaired, cause)
        else:
            repaired = replace(repaired, causes=(*repaired.causes, cause))
    return repaired


def _list_design_causes(
    examined: CheckedModel, labels: Sequence[RunLabel], grip: GripReport | None, ends: TaskEnds
) -> Iterator[Cause]:
    # Only of runs with sound numerics: an object creeps from jaws if the solver has not converged.
    unsolved = any(label.label in CONVERGED_SOLVER.labels for label in labels)
    if unsolved or examined.budget_verdict.word not in PASSING_VERDICTS:
        return
    if grip is not None:
        yield from find_lost_grip(ends.model, grip, describe_grip(grip).sentence)
    yield from find_sagging_servo(ends)
    yield from find_overrun_stop(ends)
    yield from list_undone_designs(ends)


def sections_of(names: Sequence[str]) -> tuple[SectionName, ...]:
    """Return the sections of these names, in the order of a report; all if none is named.

    Raises:
        SweepFileError: there is no such section.
    """
    for name in names:
        others = f"; there are {', '.join(SECTIONS)}"
        SweepFileError.unless_known(
            name, SECTIONS, f"no section '{name}' of an examination", others
        )
    return tuple(section for section in SECTIONS if section in names or not names)


def _check_model(
    report: Examination,
    checks: Mapping[str, Check],
    examined: CheckedModel,
    accepted: Sequence[Waiver],
) -> Examination:
    """Return a report with its checks and their findings, and the waivers that are stale."""
    results = [check(examined) for check in checks.values()]
    findings = judged_findings(results, accepted)
    stale = (
        f"'{entry.check}' is waived ({entry.reason}), but does not fail: remove the waiver"
        for entry in unused_waivers(findings, accepted)
    )
    idle = ExercisedFeatures.of_rows(
        record_to_row(run.record) for run in examined.runs
    ).idle_parts()
    if "repeat" in checks and examined.runs[0].record.trajectory_hash is not None:
        reference = describe_reference(examined.runs[0]).model_dump_json(indent=2) + "\n"
        examined.session.write({REFERENCE: reference})
    return report.model_copy(
        update={
            "checks": tuple(results),
            "findings": tuple(findings),
            "notes": (*report.notes, *stale, *map(first_names, map(examined.name_geoms, idle))),
        }
    )


def _search_fixes(
    request: ExamineRequest,
    repaired: RepairedModel,
    files: RepairedFiles | None,
    verifier: FixVerifier,
    left: Callable[[], float],
) -> FixSearch:
    """Return the fixes of a model, with its first causes repaired, that help on new seeds too."""
    examined, labels, verdict = repaired.examined, repaired.labels, repaired.examined.budget_verdict
    task, threads = examined.task, examined.threads
    if verdict.reasons:
        request.begins(f"{verdict.reasons[0].sentence}; searching a fix")

    def yield_motions(
        settings: Values, change: Change, file: Path | None
    ) -> Iterator[list[Motion]]:
        scene = examined.scenes.open(str(file)) if file else None
        for seeds in (task, with_new_seeds(task)):
            yield examined.motions_of(seeds, settings, change, scene)

    trial = Trial(SETTINGS, None, MOST_FIXES, request.apply, threads, left)

    def label_runs(settings: Values, file: Path | None) -> Iterator[tuple[RunLabel, ...]]:
        first, *others = (*task.seeds, *with_new_seeds(task).seeds)
        records, model = list[EvidenceRecord](), examined
        if file is not None:  # its file has the settings
            model, settings = open_changed_model(str(file), examined.session, request.task), {}
        for seeds in ([first], others):
            runs = model.run(_CHANGED, "With a fix", settings, seeds=seeds, trace="none")
            records += [run.record for run in runs]
            yield run_labels(task, records)

    scene, values = examined.scene.with_effects("all"), examined.values
    repeats = TaskRepeats(yield_motions, label_runs, labels, verifier.finds_harm)
    return FixSearch(scene, values, examined.motions, verdict, trial, repeats, files)


def _limit_share(limit: WorkLimit, share: float, examined: CheckedModel) -> Callable[[], float]:
    return lambda: limit.find_remainder(share, examined.motions)


def _make_repairer(
    request: ExamineRequest,
    examined: CheckedModel,
    report: Examination,
    folder: Path,
    left: Callable[[], float],
    *,
    meets_fault: bool,
) -> CauseRepairer:
    def open_repaired(
        reference: str, rows: Sequence[str], settings: Settings, drive: PolicyDrive | None
    ) -> CheckedModel:
        task = replace(request.task, drive=drive) if drive else request.task
        opened = open_changed_model(reference, examined.session, task)
        return replace(opened, rows=rows, settings=settings)

    def verify(changed: CheckedModel, elsewhere: bool) -> VerifiedChange:
        # Another start has other motions, and their errors may differ within the tolerance.
        return verify_change(
            VerificationRequest(
                original=examined,
                changed=changed,
                same_model=False,
                keeps_motion=False,
                keeps_start=not elsewhere,
                allowed_error=examined.task.tolerance,
                stop_early=True,
                find_time_left=left,
            )
        )

    def describe(repaired: RepairedModel) -> str:
        budget = budget_report(repaired.examined.budget, repaired.examined.budget_verdict, ())
        rest = {"budget": budget, "labels": repaired.labels, "findings": (), "facts": ()}
        causes = tuple(list_open_causes(repaired))
        return conclude(report.model_copy(update={**rest, "causes": causes})).headline

    return CauseRepairer(
        original=examined,
        folder=folder,
        open_model=open_repaired,
        verify=verify,
        find_time_left=left,
        describe=describe,
        meets_fault=meets_fault,
    )


def _write_result(
    request: ExamineRequest,
    examined: CheckedModel,
    report: Examination,
    verifier: FixVerifier | None,
    search: FixSearch | None,
    files: RepairedFiles | None,
) -> Examination:
    """Write the model with the applied fixes, or the first that keeps the model; or say why not."""
    if request.write is None:
        return report
    made, reason = None, report.fix
    if verifier is None and files is not None:
        reason = files.why_not_written(request.apply)
        if unknown := [word for word in request.apply if word not in files.apply]:
            reason = f"no fix is called {unknown[0]}; write one of: {', '.join(files.apply)}"
        if not reason:
            folder, name = request.write.parent, request.write.name
            made = write_model(files.scene, files.edits, folder, name).path
    elif verifier is not None and search is not None:
        made, reason = verifier.write_fix(search, request.write, requested=bool(request.apply))
    if made is None:
        examined.session.notify(f"{request.write} is not written: {reason}")
        asked = f"--apply {' --apply '.join(request.apply)}" if request.apply else ""
        reason = f"{asked}: {request.write} is not written: {reason}" if asked else ""
        return report.model_copy(update={"not_written": reason})
    own = made.resolve() == request.write.resolve()
    return report.model_copy(update={"written": str(request.write if own else made)})
