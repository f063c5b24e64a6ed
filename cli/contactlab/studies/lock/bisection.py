"""Find the release of MuJoCo that changed an outcome, in as many steps as their number has bits.

If a release has the old outcome and another one has a new outcome, two neighbors between them
differ in the same way, for any outcomes of the releases between. The search finds such neighbors.
The result of each release is kept in a folder of its own, and read from there the next time.
"""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from contactlab.comparison.compare_stores import compare_stores
from contactlab.errors import ContactlabError, ExpectationError, PolicyError, StoppedError
from contactlab.schema.comparison import ComparePolicy, ComparisonReport
from contactlab.schema.finding import Finding
from contactlab.schema.store_reports import ChangingRelease
from contactlab.step_progress import finish_step, step_count
from contactlab.store.atomic_files import atomic_write, sha256_of

# Checks that count as an outcome: those of the first of these groups that differ at the ends.
_KINDS = (frozenset({"runs", "labels"}), frozenset({"metrics"}))


def find_change(
    versions: Sequence[str], differs: Callable[[str], bool], notify: Callable[[str], None]
) -> ChangingRelease:
    """Find neighbors, one with the outcome of the first version, the other without it.

    The first and the last differ. For n versions, ceil(log2(n - 1)) are run, and more only if some
    raise a ContactlabError.
    """
    trials = math.ceil(math.log2(max(2, len(versions) - 1)))
    same, other, steps = 0, len(versions) - 1, 0
    skipped: dict[str, str] = {}
    with step_count("releases", trials) as count:
        while untested := [
            index for index in range(same + 1, other) if versions[index] not in skipped
        ]:
            middle = min(untested, key=lambda index: abs(2 * index - same - other))
            version, steps = versions[middle], steps + 1
            try:
                is_other = differs(version)
                finish_step(count)
            except StoppedError:
                raise
            except ContactlabError as error:
                skipped[version] = str(error).partition("\n")[0]
                notify(f"{version}: left out, since {skipped[version]}")
                continue
            notify(f"{version}: {'not ' if is_other else ''}as in {versions[0]}")
            same, other = (same, middle) if is_other else (middle, other)
    between = {name: skipped[name] for name in versions[same + 1 : other]}
    return ChangingRelease(
        before=versions[same], after=versions[other], skipped=between, steps=steps
    )


@dataclass
class SweepOutcomes:
    """The runs of a sweep under several releases, with their stores in one folder.

    `run` runs or resumes the sweep into a store with a release; a ContactlabError says that it
    cannot. `check_names` names the checks of the comparison that count.
    """

    folder: Path
    run: Callable[[Path, str], None]
    policy: ComparePolicy
    check_names: Sequence[str] = ()
    good: str = field(default="", init=False)
    names: frozenset[str] = field(default=frozenset(), init=False)

    def begin(self, good: str, bad: str) -> None:
        """Find the differences of the two ends; raise an ExpectationError without any."""
        self.good = good
        report = self.compare_releases(good, bad)
        for name in self.check_names:
            check_names = [check.name for check in report.findings]
            PolicyError.unless_known(name, check_names, f"there is no check '{name}'")
        differing = [
            check
            for check in report.findings
            if check.name in self.check_names and _is_different(check)
        ]
        if not self.check_names:
            differing = next(filter(None, (_of_kinds(report, kinds) for kinds in _KINDS)), [])
        if not differing:
            raise ExpectationError(f"MuJoCo {good} and {bad} give the same; see {self.folder}")
        self.names = frozenset(check.full_name for check in differing)

    def differs(self, version: str) -> bool:
        """Return whether any of these outcomes differs from that of the first release."""
        return bool(self._has_changed(self.compare_releases(self.good, version)))

    def report_change(self, change: ChangingRelease) -> ComparisonReport:
        """Return the comparison of two neighbors, with the outcomes that changed."""
        report = self.compare_releases(change.before, change.after)
        if not self._has_changed(
            report
        ):  # by less than the tolerance, which was almost used up before
            report = self.compare_releases(self.good, change.after)
        return report.model_copy(update={"findings": tuple(self._has_changed(report))})

    def compare_releases(self, before: str, after: str) -> ComparisonReport:
        """Return the comparison of two releases, run by run."""
        for version in (before, after):
            self.run(self.folder / version, version)
        policy = self.policy.model_copy(update={"match": "axes"})
        return compare_stores(self.folder / before, self.folder / after, policy)

    def _has_changed(self, report: ComparisonReport) -> list[Finding]:
        return [
            check
            for check in report.findings
            if check.full_name in self.names and _is_different(check)
        ]


def _of_kinds(report: ComparisonReport, kinds: frozenset[str]) -> list[Finding]:
    """Return the checks of some kinds that fail; without any, those that changed."""
    differing = [check for check in report.findings if check.kind in kinds and _is_different(check)]
    return [check for check in differing if check.outcome == "failed"] or differing


def _is_different(check: Finding) -> bool:
    return check.verdict not in {"same", "not comparable"}


def remember_outcome(node: str, folder: Path, run: Callable[[], bool]) -> bool:
    """Return whether a test passes, as a folder says if neither its file nor its name changed."""
    source, place = Path(node.partition("::")[0]), folder / "outcome.json"
    test_key = {"test": node, "sha256": sha256_of(source) if source.is_file() else None}
    for passed in (True, False):
        outcome_text = json.dumps({**test_key, "passed": passed})
        if place.is_file() and place.read_text(encoding="utf-8") == outcome_text:
            return passed
    passed = run()
    with atomic_write(place) as temporary:
        temporary.write_text(json.dumps({**test_key, "passed": passed}), encoding="utf-8")
    return passed
