"""Runs of the model under check, and of other scenes with its parameters."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

from contactlab.engines import bytes_of_run
from contactlab.errors import SweepFileError
from contactlab.run.planned_runs import RUN_BYTES
from contactlab.scene.resolution import steps_of
from contactlab.scene.setting_values import as_number
from contactlab.schema.drive import Drive, drive_data
from contactlab.studies.check.checked_model import CheckedModel, CheckRun
from contactlab.studies.check.held_pairs import Holding, holding_of
from contactlab.studies.session import Session, Values

NOMINAL_STORE, HOLD_STORE = "run", "hold"
"""Names of the stores of the nominal run, that of the model as it is, and of one that holds."""

MOST_STEPS = 300_000
"""Steps of a run that a check makes at most, beside the nominal one."""


class TooLongError(SweepFileError):
    """A run that a check would make takes too long, or too much memory."""


@dataclass
class CheckRunner:
    """Runs a model, or other scenes with its parameters, for checks.

    A brief one makes only the runs that measures with limits need.
    """

    checked: CheckedModel
    session: Session
    brief: bool = False
    _stores: dict[str, None] = field(default_factory=dict[str, None])

    def trying(self, settings: Values, folder: str) -> "CheckRunner":
        """Return a runner of the model with more settings, into a folder below this one's."""
        session = replace(self.session, folder=self.session.folder / folder)
        return CheckRunner(self.checked.changed(settings), session, brief=True)

    @cached_property
    def nominal(self) -> CheckRun:
        """The run of the model as it is, with every check of its trace."""
        checks = "none" if self.brief else "all"
        return self.run(NOMINAL_STORE, "The model as it is", [{}], checks=checks)[0]

    @cached_property
    def standing(self) -> CheckRun:
        """The run that a hold is judged by: under an exercise, one that keeps the start posture."""
        if self.checked.scene.drive.drive != "exercise":
            return self.nominal
        text = "The model as it is, keeping its posture"
        return self.run(HOLD_STORE, text, [{}], drive="hold", checks="none")[0]

    @cached_property
    def holding(self) -> Holding:
        """What that run holds, and what stands in it."""
        return holding_of(self.checked, self.standing)

    @property
    def has_nominal(self) -> bool:
        """Whether the nominal run was needed by any check."""
        return NOMINAL_STORE in self._stores

    def fits(self, timestep: float, seconds: float) -> bool:
        """Say whether a run of a duration [s] at a timestep [s] is short enough to be made."""
        return self._is_short(self.checked.reference, {"timestep": timestep}, seconds)

    def run(
        self,
        name: str,
        description: str,
        rows: Sequence[Values],
        *,
        duration: float | None = None,
        drive: Drive | None = None,
        **keys: object,
    ) -> list[CheckRun]:
        """Run the model with the settings of each row, beyond those under check, into a store.

        Duration [s] and drive are the model's unless given; `keys` are more of a sweep file.

        Raises:
            TooLongError: a run takes too many steps, or too much memory.
        """
        whole = [{**self.checked.values, **row} for row in rows]
        seconds = self.checked.duration if duration is None else duration
        reference, drive = self.checked.reference, drive or self.checked.drive
        if self.brief or name != NOMINAL_STORE:
            self._require_short(reference, whole, seconds)
        runs = self._run(name, description, reference, whole, duration=seconds, drive=drive, **keys)
        return [replace(run, row=row) for row, run in zip(rows, runs, strict=True)]

    def run_scene(
        self, name: str, description: str, reference: str, rows: Sequence[Values], duration: float
    ) -> list[CheckRun]:
        """Run any scene; see `run`."""
        self._require_short(reference, rows, duration)
        return self._run(name, description, reference, rows, duration=duration)

    def _run(
        self,
        name: str,
        description: str,
        reference: str,
        rows: Sequence[Values],
        *,
        duration: float,
        drive: Drive | None = None,
        **keys: object,
    ) -> list[CheckRun]:
        first, *others = rows
        sweep = {
            "version": 1,
            "scene": reference,
            "description": description,
            "axes": {axis: [value] for axis, value in first.items()},
            "include": others,
            "trace": "all",
            "duration": duration,
            **({} if drive is None else {"drive": drive_data(drive)}),
            **keys,
        }
        scenes = self.checked.scenes
        store = self.session.run_derived(name, sweep, scenes)
        self._stores[name] = None
        scene = scenes.driven(reference, drive)
        ids = [scene.run_id(scene.resolve(row, 0, duration)) for row in rows]
        return [
            CheckRun(row, row, store, store.record(run)) for row, run in zip(rows, ids, strict=True)
        ]

    def _require_short(self, reference: str, rows: Sequence[Values], seconds: float) -> None:
        for row in rows:
            if not self._is_short(reference, row, seconds):
                steps = steps_of(seconds, as_number(row["timestep"]))
                raise TooLongError(f"a run of {seconds:g} s would take {steps:,} steps")

    def _is_short(self, reference: str, row: Values, seconds: float) -> bool:
        if "timestep" not in row:
            return True
        steps = steps_of(seconds, as_number(row["timestep"]))
        model = self.checked.scenes.open(reference).base({}).model
        return steps <= MOST_STEPS and bytes_of_run(model, steps) <= RUN_BYTES

    def stores(self, *names: str) -> tuple[str, ...]:
        """Return which of these stores were written."""
        return tuple(name for name in names if name in self._stores)
