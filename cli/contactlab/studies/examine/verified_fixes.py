"""Verifies the fixes that an examination prints first or writes, and drops those that harm."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from contactlab.budget.verdict import Verdict
from contactlab.errors import SceneError
from contactlab.measure.assessment import NUMERICAL_CAUSE
from contactlab.modifications.modification import Candidate
from contactlab.reporting.examination import first_fix
from contactlab.scene.model_draft import ModelEdits
from contactlab.schema.examination import Fix, RejectedFix, RunLabel
from contactlab.schema.verification import VerifiedChange
from contactlab.studies.examine.fixes import FixSearch
from contactlab.studies.examine.linted_file import lint_file
from contactlab.studies.verification import (
    OriginalRuns,
    Verification,
    VerificationRequest,
    count_labels,
    has_policy,
)
from contactlab.tasks.checked_model import CheckedModel

_NUMERICAL = ("inaccurate", "undecided")
_LOOP_MEASURES = ("tracking error", "end position")


@dataclass
class FixVerifier:
    """Verifies fixes of one model.

    Attributes:
        examined: the model.
        verdict: the verdict that they are against.
        labels: failure labels of the model's runs.
        open_changed: opens the file of a changed model under the same task.
        find_time_left: returns the counted time until verifications end early [s].
        faulty_rules: rules of lint that find faults of the model's step; no fix of its numerics
            leaves one.
        rejected: fixes that were dropped, with the reason.
    """

    examined: CheckedModel
    verdict: Verdict
    labels: Sequence[RunLabel]
    open_changed: Callable[[str], CheckedModel]
    find_time_left: Callable[[], float]
    faulty_rules: frozenset[str] = frozenset()
    rejected: list[RejectedFix] = field(default_factory=list[RejectedFix])
    _begun: dict[str, Verification] = field(default_factory=dict[str, Verification])
    _verifications: dict[str, VerifiedChange] = field(default_factory=dict[str, VerifiedChange])
    _runs: OriginalRuns = field(default_factory=OriginalRuns)

    def finds_harm(self, search: FixSearch, candidate: Candidate, edits: ModelEdits) -> bool:
        """Return whether a load rejects a fix against the verdict, before it is judged further."""
        whole = search.whole_edits(edits)
        request = self._make_request(
            search, candidate.name, whole, self.find_time_left, removes_verdict=True
        )
        self._begun[candidate.name] = Verification(request)
        harms = self._begun[candidate.name].run_loads()
        if harms:
            verification = self._begun.pop(candidate.name).complete_runs()
            self.rejected.append(RejectedFix(name=candidate.name, reason=verification.sentence))
        return harms

    def recommend_fixes(self, search: FixSearch) -> tuple[Fix, ...]:
        """Return the fixes to report; the first has passed its verification.

        Those that did not pass are dropped from the search.
        """
        while (fixes := search.reported_fixes()) or search.search_further():
            faulty = {fix.name: why for fix in fixes if (why := self._find_fault_left(search, fix))}
            for name, why in faulty.items():
                self.rejected.append(RejectedFix(name=name, reason=why))
                search.drop_fix(name)
            if not fixes or faulty:
                continue
            first = first_fix(fixes)
            edits = search.find_edits(first.name)
            removes_verdict = first.removes == "verdict"
            request = self._make_request(
                search, first.name, edits, self.find_time_left, removes_verdict=removes_verdict
            )
            verification = self._verify_once(first.name, request)
            if verification.passed:
                verified = first.model_copy(update={"verification": verification})
                return tuple(verified if fix is first else fix for fix in fixes)
            self._drop_fix(search, first.name, verification)
        return ()

    def write_fix(
        self, search: FixSearch, file: Path, *, requested: bool
    ) -> tuple[Path | None, str]:
        """Write the model with the requested fixes, or with the first that keeps it and passes.

        Returns:
            the file of the model, which may be in a folder with files that it includes; None if it
            was not written.
            the reason why not, or "".

        Raises:
            OutputError: the file cannot be written.
        """
        while True:
            name, edits, reason = search.choose_edits()
            if reason:
                return None, reason
            removes_verdict = name not in {fix.name for fix in search.without_labels}
            request = self._make_request(
                search, name, edits, lambda: math.inf, removes_verdict=removes_verdict
            )
            verification = self._verify_once(name, request)
            if verification.passed:
                return search.write_edits(edits, file.parent, file.name).path, ""
            if requested:
                return None, f"{name}: {verification.sentence}"
            self._drop_fix(search, name, verification)

    def _find_fault_left(self, search: FixSearch, fix: Fix) -> str:
        # Half a step may remove the error of a run although a joint grows until its motor is full.
        if not self.faulty_rules or self.verdict.word not in _NUMERICAL:
            return ""
        try:
            written = search.write_once(fix.name, search.find_edits(fix.name))
        except SceneError:
            return ""
        source = self.examined.scenes.open(written.reference).source
        linted = lint_file(source, written.reference, self.examined.task.start)
        return next(
            (
                f"it leaves: {one.sentence}"
                for one in linted.faults
                if one.rule in self.faulty_rules
            ),
            "",
        )

    def _drop_fix(self, search: FixSearch, name: str, verification: VerifiedChange) -> None:
        self.rejected.append(RejectedFix(name=name, reason=verification.sentence))
        search.drop_fix(name)

    @property
    def _caused_labels(self) -> set[str]:
        # Numerics cause these labels of the original.
        return {label.label for label in self.labels if NUMERICAL_CAUSE in label.reason}

    def _make_request(
        self,
        search: FixSearch,
        name: str,
        edits: ModelEdits,
        find_time_left: Callable[[], float],
        *,
        removes_verdict: bool,
    ) -> VerificationRequest:
        numerical = removes_verdict and self.verdict.word in _NUMERICAL
        computed = numerical and not search.changes_model(name)
        in_loop = has_policy(self.examined)
        # A fix that removes a failure moves bodies otherwise, and so does another model in a loop,
        # which may end an oscillation.
        keeps_motion = (
            numerical
            and not self._caused_labels
            and not edits.fixes_start
            and (computed or not in_loop)
        )
        if self.labels:
            self._runs.labels.setdefault("task", count_labels(self.labels))
        return VerificationRequest(
            original=self.examined,
            changed=self._open_edited(search, name, edits),
            same_model=computed,
            keeps_motion=keeps_motion,
            # Links without a contact that jams them come to rest elsewhere, too.
            keeps_start=not edits.fixes_start,
            must_improve=_LOOP_MEASURES if in_loop and keeps_motion else (),
            allowed_error=self.examined.task.tolerance if numerical else 0.0,
            stop_early=True,
            runs=self._runs,
            find_time_left=find_time_left,
        )

    def _verify_once(self, name: str, request: VerificationRequest) -> VerifiedChange:
        earlier = self._verifications.get(name)
        if earlier is not None and not earlier.ended_early:
            return earlier
        begun = self._begun.pop(name, None) or Verification(request)
        verification = begun.complete_runs()
        numerical = request.allowed_error > 0
        labels_left = [
            label for label in self._caused_labels if numerical and _runs_with(verification, label)
        ]
        if verification.passed and labels_left:
            sentence = f"it leaves {' and '.join(sorted(labels_left))}"
            verification = verification.model_copy(update={"passed": False, "sentence": sentence})
        if verification.identical:
            sentence = "its runs are bit for bit those of the model as written"
            verification = verification.model_copy(update={"passed": False, "sentence": sentence})
        self._verifications[name] = verification
        return verification

    def _open_edited(self, search: FixSearch, name: str, edits: ModelEdits) -> CheckedModel:
        try:
            return self.open_changed(search.write_once(name, edits).reference)
        except SceneError:
            # Some models cannot be written with a change, such as flexes, but run with settings.
            return replace(self.examined, values={**self.examined.values, **edits.settings})


def _runs_with(verification: VerifiedChange, label: str) -> float:
    return sum(
        measure.after or 0.0
        for measure in verification.measures
        if measure.name == f"label {label}"
    )
