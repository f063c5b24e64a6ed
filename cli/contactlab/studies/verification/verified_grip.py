"""Judges a grip, and verifies the fix that it recommends."""

from collections.abc import Sequence
from pathlib import Path

from contactlab.errors import EngineError, SceneError
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.model_writer import write_model
from contactlab.schema.grip import GripFix, GripReport
from contactlab.schema.verification import VerifiedChange
from contactlab.step_progress import count_steps
from contactlab.studies.grip.gripping import GripRequest, edit_grip, judge_grip
from contactlab.studies.verification.panel import OriginalRuns, VerificationRequest, verify_change
from contactlab.tasks.checked_model import open_changed_model, open_model
from contactlab.tasks.session import Session
from contactlab.temporary_folders import temporary_folder


def judge_verified_grip(request: GripRequest) -> GripReport:
    """Judge a grip; the fix in its sentence passed its verification.

    Raises:
        SceneError: there is no such model, keyframe or body; nothing closes, or nothing is held.
        SweepFileError: a squeeze is requested for a keyframe, or is more than the actuators give.
    """
    report = judge_grip(request)
    if not any(fix.lines for fix in report.fixes if fix.verdict == "holds"):
        return report
    fixes, runs = list(report.fixes), OriginalRuns()
    for place, fix in enumerate(count_steps(report.fixes, "verified fixes", len(fixes))):
        if fix.verdict != "holds" or not fix.lines:
            continue
        request.notify(f"verifying {fix.name}")
        # Other controls begin another motion, so settings are first verified with the original's.
        verification: VerifiedChange | None = None
        if fix.keyframe_controls and fix.options:
            settings = fix.model_copy(update={"keyframe_controls": ()})
            verification = _verify_edits(request, settings, runs)
        if verification is None or verification.passed:
            verification = _verify_edits(request, fix, runs)
        if verification.passed:
            fixes[place] = fix.model_copy(update={"verification": verification})
            return _recommend_fix(report, fixes, "")
        rejected = {"lines": (), "no_patch_reason": verification.sentence}
        fixes[place] = fix.model_copy(update=rejected)
    return _recommend_fix(report, fixes, "each makes something worse")


def _recommend_fix(report: GripReport, fixes: Sequence[GripFix], reason: str) -> GripReport:
    """Return the report with verified fixes first, and the first of them in its sentence."""
    ranked = sorted(fixes, key=lambda fix: fix.verification is None)
    head = report.sentence.partition(". Fix: ")[0]
    first = next((fix for fix in ranked if fix.verdict == "holds" and not reason), None)
    if first is None:
        text = f"{head}. No fix: {reason}"
    else:
        cost = f", x{first.time_ratio.ratio:.2g} time" if first.time_ratio else ""
        text = f"{head}. Fix: {first.name} ({1e3 * (first.speed or 0.0):.3g} mm/s{cost})"
    return report.model_copy(update={"fixes": tuple(ranked), "sentence": text})


def _verify_edits(request: GripRequest, fix: GripFix, runs: OriginalRuns) -> VerifiedChange:
    with temporary_folder() as folder:
        session = Session(Path(folder) / "results")
        scene = SceneLoader(Path()).open(request.model).with_effects("all")
        edits = edit_grip(request.keyframe, fix.options, fix.keyframe_controls)
        written_model = write_model(scene, edits, Path(folder) / "changed")
        original = open_model(request.model, session)
        changed = open_changed_model(written_model.reference, session)
        request_of_fix = VerificationRequest(
            original=original,
            changed=changed,
            same_model=False,
            keeps_motion=False,
            keeps_start=not fix.keyframe_controls,
            stop_early=True,
            with_labels=False,
            runs=runs,
        )
        try:
            return verify_change(request_of_fix)
        except (EngineError, SceneError) as error:
            reason = str(error).splitlines()[0]
            return VerifiedChange(passed=False, identical=False, sentence=reason)
