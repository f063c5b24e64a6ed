"""The accuracy pass: every run against its reference, once all runs are recorded."""

from collections.abc import Mapping

from contactlab.run.clamping import is_clamped, solref_rules
from contactlab.run.job import Job, PlannedRun, Task
from contactlab.run.jobs import Planned
from contactlab.run.notes import Note
from contactlab.scene import ResolvedRun, Scene, with_reference_numerics
from contactlab.schema import Accuracy, ErrorKind, SolrefRule

_NOTHING: Note = {}


def families(planned: Planned, scene: Scene) -> list[Job]:
    """Return runs grouped by all that they share but numerics, and so by their reference."""
    found: dict[str, list[PlannedRun]] = {}
    for run, resolved in planned:
        shared = scene.run_id(with_reference_numerics(resolved, "RK4", 1.0))
        found.setdefault(shared, []).append(run)
    return [tuple(runs) for runs in found.values()]


def accuracies(
    task: Task, scene: Scene, planned: Planned, notes: Mapping[str, Note]
) -> dict[str, Accuracy]:
    """Return the accuracy of every run.

    Args:
        task: the sweep's.
        scene: theirs.
        planned: the runs.
        notes: run id to what was found out in the pass; nothing of runs that it left out.
    """
    kind = _kind(task, notes)
    rules = solref_rules({run.run_id: resolved for run, resolved in planned})
    return {
        run.run_id: _accuracy(
            notes.get(run.run_id, _NOTHING), kind, rules[run.run_id], clamped=_clamped(scene, each)
        )
        for run, each in planned
    }


def _kind(task: Task, notes: Mapping[str, Note]) -> ErrorKind:
    """Return one kind of error for all runs, or else they could not be compared."""
    assert task.sweep.accuracy is not None
    asked = task.sweep.accuracy.error
    if asked != "auto":
        return asked
    known = [each["chaotic"] for each in notes.values() if each.get("chaotic") is not None]
    return "invariants" if sum(known) > len(known) / 2 else "trajectory"


def _accuracy(note: Note, kind: ErrorKind, rule: SolrefRule | None, *, clamped: bool) -> Accuracy:
    error = note.get(kind, _NOTHING)
    return Accuracy(
        error_final=error.get("final"),
        error_mean=error.get("mean"),
        error_peak=error.get("peak"),
        error_estimate=error.get("estimate"),
        error_final_estimate=error.get("final_estimate"),
        error_mean_estimate=error.get("mean_estimate"),
        error_kind=kind,
        chaotic=note.get("chaotic"),
        reference_integrator=note.get("integrator"),
        reference_timestep=note.get("timestep"),
        impacts=note.get("impacts"),
        solref_rule=rule,
        solref_clamped=clamped,
    )


def _clamped(scene: Scene, run: ResolvedRun) -> bool:
    pairs = scene.base_of(run).prepare(run.edits()).pairs
    return is_clamped(run, [pair.solref for pair in pairs.values()])
