"""The smaller model: without the parts that may go together, written and verified together.

Parts that add error go back, those that save least first, until no measure is worse than that of
the model as written.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from shutil import rmtree

import mujoco

from contactlab.budget import Motion
from contactlab.budget.counted_time import count_pace
from contactlab.errors import EngineError, SceneError
from contactlab.rendering.amounts import format_percent
from contactlab.reporting.verified_measures import describe_measure
from contactlab.scene.model_draft import ModelEdits
from contactlab.scene.model_writer import WrittenModel, write_model
from contactlab.schema.effects_report import FOLDER, SmallerModel
from contactlab.schema.time_ratio import LEAST_SAVING, TimeRatio
from contactlab.schema.verification import VerifiedChange
from contactlab.studies.effects.examined_scenarios import Scenarios
from contactlab.studies.effects.model_parts import ModelPart, change_model
from contactlab.studies.effects.part_errors import LOAD_MARGIN, MeasuredPart, PartErrors
from contactlab.studies.verification import OriginalRuns, VerificationRequest, verify_change
from contactlab.studies.verification.grip_measures import compare_grips
from contactlab.studies.verification.panel_cost import (
    estimate_panel,
    fewest_windows_share,
    fit_panel,
)
from contactlab.tasks.checked_model import CheckedModel
from contactlab.tasks.compiled_changes import compile_changed
from contactlab.tasks.reference_error import ErrorEstimate
from contactlab.tasks.session import Session
from contactlab.tasks.stress_motions import KnownStates, double_inputs, tilt_gravity
from contactlab.tasks.task_clock import Clock
from contactlab.tasks.task_motions import with_new_seeds
from contactlab.tasks.time_limit import TimeLimit

EXACT = (
    "the motion is that of the model as written, bit for bit, in the task, on fresh seeds, tilted, "
    "and with twice the inputs"
)


@dataclass
class SmallerSearch:
    """Finds, writes and verifies the smaller model.

    Attributes:
        scenarios: the model as written.
        session: the folder of results.
        clock: that times models.
        errors: that measures models without parts together.
        base: the model as written, compiled from its files.
        runs: of the model as written, for its verification.
        time_limit: the time limit.
        write: file of the model; None for the session's folder.
        needed_parts: parts that stay, since another load needs them, with the measure that was
            worse.
        is_late: whether the time limit ended the verification.
    """

    scenarios: Scenarios
    session: Session
    clock: Clock
    errors: PartErrors
    base: mujoco.MjModel
    runs: OriginalRuns
    time_limit: TimeLimit
    write: Path | None = None
    needed_parts: dict[str, str] = field(default_factory=dict[str, str])
    is_late: bool = False

    def find_smaller(self, free: Sequence[MeasuredPart]) -> SmallerModel | None:
        """Return the smaller model; None if no set of parts saves enough and passes."""
        rmtree(self.session.folder / FOLDER, ignore_errors=True)
        chosen = [one for one in free if one.ratio is not None and one.saves_work]
        chosen.sort(key=lambda one: one.cost)
        while chosen:
            parts = [one.part for one in chosen]
            error = self._estimate_joint_error(parts)
            if (
                error is not None
                and error.error > LOAD_MARGIN * self._original_model.task.tolerance
            ):
                self._put_back(chosen, f"together they differ by {error.error:.2g} in {error.body}")
                continue
            edits = ModelEdits()
            for part in parts:
                assert part.edits
                edits = edits.joined_with(part.edits)
            try:
                smaller_model = self._compile_without(edits, parts)
                (cost,) = self.clock.count_costs([(smaller_model, 1)])
                if cost > 1 - LEAST_SAVING:
                    return None
                written_model = write_model(
                    self._original_model.scene, edits, self._written_folder, self._written_name
                )
            except SceneError as refused:
                self._put_back(chosen, str(refused).splitlines()[0])
                continue
            changed = self.scenarios.open_written(written_model, edits)
            verified, sentence, passed = self._verify_model(changed)
            sentence += self._describe_shortening() if passed else ""
            if passed:
                time_ratio = self._time_whole_runs(smaller_model)
                # Counted work decides while the interval leaves a saving open: a busy machine
                # writes the same model.
                if time_ratio.low > 1 - LEAST_SAVING:
                    self._discard_files(written_model)
                    return None
                return SmallerModel(
                    left_out=tuple(part.name for part in parts),
                    error=error.error if error else 0.0,
                    time_ratio=time_ratio,
                    file=self._file_of(written_model),
                    lines=written_model.lines,
                    verified=verified,
                    sentence=sentence,
                )
            self._discard_files(written_model)
            if self.is_late:
                # Nothing but equal bits can be verified in no time.
                lossy = [one for one in chosen if not one.part.proof]
                chosen = [one for one in chosen if one.part.proof] if lossy else []
                continue
            self._put_back(chosen, sentence)
        return None

    @property
    def _original_model(self) -> CheckedModel:
        return self.scenarios.models[0]

    @property
    def _written_folder(self) -> Path:
        return self.session.folder / FOLDER if self.write is None else self.write.parent

    @property
    def _written_name(self) -> str:
        return "" if self.write is None else self.write.name

    def _file_of(self, written_model: WrittenModel) -> str:
        path = written_model.path
        own = self.session.folder.resolve()
        return str(path.relative_to(own)) if path.is_relative_to(own) else str(path)

    def _discard_files(self, written_model: WrittenModel) -> None:
        if self.write is None:
            rmtree(self._written_folder, ignore_errors=True)
            return
        for path in (written_model.path, written_model.path.with_suffix(".patch")):
            path.unlink(missing_ok=True)

    def _put_back(self, chosen: list[MeasuredPart], reason: str) -> None:
        # The part that saves least stays, of those that add error if there are any.
        lossy = [one for one in chosen if not one.part.proof] or chosen
        least = max(lossy, key=lambda one: one.cost)
        chosen.remove(least)
        self.needed_parts[least.part.name] = reason

    def _estimate_joint_error(self, parts: Sequence[ModelPart]) -> ErrorEstimate | None:
        lossy = [part for part in parts if not part.proof]
        return self.errors.estimate_error(lossy) if lossy else None

    def _compile_without(self, edits: ModelEdits, parts: Sequence[ModelPart]) -> mujoco.MjModel:
        if any(part.recompiles for part in parts):
            return compile_changed(self._original_model, edits)
        return change_model(self.base, *(part.change for part in parts))

    @cached_property
    def _panel_size(self) -> tuple[int, float]:
        # Seeds, and the share of the length of runs, that the remaining time allows. They stay the
        # same, since the runs of the model as written are kept.
        original = self._original_model
        motions, first_share = original.motions, 0.6  # of the time, for the first set
        model, pace = motions[0].model, count_pace(motions)

        def estimate_seconds(seeds: int, share: float) -> float:
            return estimate_panel(model, original.task, seeds, share, pace).first

        allowed = first_share * self.time_limit.remaining
        seeds, share = fit_panel(estimate_seconds, len(original.task.seeds), allowed)
        return seeds, max(fewest_windows_share(original.task), min(1.0, share))

    def _describe_shortening(self) -> str:
        task, (seeds, share) = self._original_model.task, self._panel_size
        shortenings = [f"{seeds} of {len(task.seeds)} seeds"] if seeds < len(task.seeds) else []
        if share < 1:
            shortenings.append(f"runs of {share * task.duration:.2g} s for {task.duration:g} s")
        return (
            f"; {' and '.join(shortenings)}, since --max-cpu allows no more" if shortenings else ""
        )

    def _verify_model(self, changed: CheckedModel) -> tuple[VerifiedChange | None, str, bool]:
        # There are no measures if each bit of the motion is equal.
        original = self._original_model
        self.session.notify("verifying the smaller model")
        if self._moves_alike(changed):
            grips = compare_grips(original, changed, self.runs.grips)
            lost = next((measure for measure in grips if measure.worse), None)
            return None, describe_measure(lost) if lost else EXACT, lost is None
        request = VerificationRequest(
            original=original,
            changed=changed,
            same_model=False,
            allowed_error=original.task.tolerance,
            stop_early=True,
            most_seeds=self._panel_size[0],
            length_share=self._panel_size[1],
            runs=self.runs,
            find_time_left=lambda: self.time_limit.remaining,
        )
        try:
            verified_change = verify_change(request)
        except EngineError as error:
            return None, str(error).splitlines()[0], False
        self.is_late = verified_change.passed and verified_change.ended_early
        return (
            verified_change,
            verified_change.sentence,
            verified_change.passed and not verified_change.ended_early,
        )

    def _moves_alike(self, changed: CheckedModel) -> bool:
        seeds, threads = self._panel_size[0], self._original_model.threads
        own = KnownStates([*_load_motions(self._original_model, seeds)], threads)
        return own.match_motions([*_load_motions(changed, seeds)])

    def _time_whole_runs(self, smaller_model: mujoco.MjModel) -> TimeRatio:
        timing_share = 0.3  # of the remaining time, for the written model
        least = (1 - timing_share) * self.time_limit.remaining
        (ratio,) = self.clock.time_whole_runs(
            [(smaller_model, 1)],
            self._list_tasks(),
            lambda: self.time_limit.remaining > max(0.0, least),
        )
        return ratio

    def _list_tasks(self) -> Iterator[Sequence[Motion]]:
        yield self._original_model.motions
        task = self._original_model.task
        for _ in range(6):  # seeds differ more than turns do
            task = with_new_seeds(task)
            yield self._original_model.motions_of(task)


def _load_motions(checked: CheckedModel, seeds: int) -> Iterator[Motion]:
    own = checked.task.model_copy(update={"seeds": checked.task.seeds[:seeds]})
    for task in (own, with_new_seeds(own)):
        for motion in checked.motions_of(task):
            yield from (motion, tilt_gravity(motion), double_inputs(motion))


def describe_result(smaller: SmallerModel | None, search: SmallerSearch) -> str:
    """Return the result in a sentence."""
    if smaller is not None:
        names = ", ".join(smaller.left_out)
        ratio = smaller.time_ratio
        noise = ", which is within noise" if ratio.low <= 1 <= ratio.high else ""
        return f"The smaller model, without {names}, takes {ratio.text} of the time{noise}"
    if search.is_late:
        return "No smaller model: the CPU limit ended its verification"
    return f"No smaller model: no set of parts saves more than {format_percent(LEAST_SAVING)}"
