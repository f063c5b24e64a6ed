"""What an examination says of a model of the corpus, and whether the change that it names mends it.

The change is written into the model's file, as `--write` does, and that file is stepped by plain
MuJoCo: what is true of the failing model must no longer be above its limit.
"""

import json
import re
import sys
import tempfile
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from pathlib import Path

from tests.verdicts.corpus import FOLDER, Case, read_part
from tests.verdicts.judge import said_in_its_own_process
from tests.verdicts.motion import watch

import contactlab
from contactlab.errors import ContactlabError
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.model_writer import write_model
from contactlab.schema.examination import Examination, Fix
from contactlab.studies.examine.fixes import edits_of

_JUDGED = ("labels", "budget", "facts")
_MOST_IN = re.compile(r", most in (.+?) \(limit")


@dataclass(frozen=True)
class Asked:
    """A model of a case that is to be examined."""

    part: str
    case: Case
    healthy: bool


@dataclass(frozen=True)
class Examined:
    """What was said of a model.

    Attributes:
        sentence: the verdict in words; of what could not be examined, why.
        word: of the error budget; "" if there is none.
        labels: of the runs.
        rows: of the model, those that judge: their shares.
        named: names that the first reason gives, or else the bodies of labels.
        change: the one that is told first; "" if none is.
        mended: what is true of the changed model, in units of the limit; None without a change.
        shares: of the run, of energy.
    """

    sentence: str
    word: str = ""
    labels: tuple[str, ...] = ()
    rows: dict[str, float] = field(default_factory=dict[str, float])
    named: tuple[str, ...] = ()
    change: str = ""
    mended: float | None = None
    shares: tuple[float | None, float | None] = (None, None)

    @property
    def unresolved(self) -> bool:
        """Whether its numerics are not those of its model, or not known to be."""
        return self.word in ("inaccurate", "undecided")

    @property
    def found(self) -> bool:
        """Whether anything is told that is not sound."""
        return self.unresolved or bool(self.labels) or bool(self.rows)

    def names(self, where: Iterable[str]) -> bool:
        """Return whether it names one of these, as a word."""
        words = {word for name in self.named for word in (name, *name.replace("-", " ").split())}
        return not words.isdisjoint(where)


def examine(path: Path, case: Case, *, healthy: bool) -> Examined:
    """Examine a model with the controls of its keyframe, and mend a failing one."""
    sections = _JUDGED if healthy else (*_JUDGED, "fixes")
    try:
        report = contactlab.examine(
            path, section=sections, drive="none", duration=f"{case.duration} s", workers=1
        )
    except ContactlabError as error:
        return Examined(str(error))
    budget = report.budget
    first = (
        max(budget.phases, key=lambda phase: phase.numerical_error.error or 1e9) if budget else None
    )
    reasons = budget.reasons if budget else ()
    return Examined(
        sentence=report.headline,
        word=budget.verdict if budget else "",
        labels=tuple(dict.fromkeys(label.label for label in report.labels)),
        rows={reason.row: reason.error or 1e9 for reason in reasons if reason.verdict == "depends"},
        named=_named(report),
        change=report.fixes[0].name if report.fixes else "",
        mended=_mended(path, report.fixes[0], case) if report.fixes else None,
        shares=(first.numerical_error.error, first.energy_drift) if first else (None, None),
    )


def _named(report: Examination) -> tuple[str, ...]:
    reasons = report.budget.reasons if report.budget else ()
    bodies = tuple(body for label in report.labels for body in label.bodies)
    said = (_MOST_IN.search(label.reason) for label in report.labels)
    bodies += tuple(found[1] for found in said if found)
    return (reasons[0].body, reasons[0].place, *bodies) if reasons else bodies


def _mended(path: Path, change: Fix, case: Case) -> float | None:
    with tempfile.TemporaryDirectory() as folder:
        scene = SceneLoader(Path(), "none").open(str(path))
        made = write_model(scene, edits_of(change, scene), Path(folder) / "changed")
        motion = watch(made.path.read_text(encoding="utf-8"), case.duration)
    return case.truth.measure(motion) / case.limit


def all_examined(
    asked: Iterable[Asked], *, workers: int, seconds: float
) -> Iterator[tuple[Asked, Examined]]:
    """Examine models side by side, each in a process of its own and within a time."""
    with ThreadPoolExecutor(workers) as pool:
        trials = {pool.submit(_tried, each, seconds): each for each in asked}
        for trial in as_completed(trials):
            yield trials[trial], trial.result()


def _tried(asked: Asked, seconds: float) -> Examined:
    model = "healthy" if asked.healthy else "failing"
    module = "tests.verdicts.examined"
    said = said_in_its_own_process([module, asked.part, asked.case.name, model], seconds)
    return Examined(f"{said[0]}: {said[1]}") if isinstance(said, tuple) else Examined(**said)


def _main(part: str, name: str, model: str) -> None:
    case = next(case for case in read_part(FOLDER / part).cases if case.name == name)
    healthy = model == "healthy"
    path = Path("model.xml")
    path.write_text(case.text(healthy=healthy), encoding="utf-8")
    sys.stdout.write(json.dumps(asdict(examine(path, case, healthy=healthy))) + "\n")


if __name__ == "__main__":
    _main(*sys.argv[1:])
