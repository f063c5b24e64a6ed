"""Discretization errors: compares every run with its reference, which families of runs share."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from contactlab.accuracy.reference import (
    Discrepancy,
    Family,
    PlannedModel,
    ReferenceSolution,
    with_reference_numerics,
)
from contactlab.contact.contact_laws import refsafe_solref
from contactlab.contact.trace_arrays import Floats
from contactlab.engines import Watch
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.scene import Scene
from contactlab.schema.evidence import Accuracy, SolrefRule
from contactlab.schema.sweep_schema import AccuracyRequest

Note = Mapping[str, Any]
"""Results of a pass for one run, in JSON's types; empty if the run does not complete."""

_MOST_BYTES_OF_STATES = 32 << 20  # of a reference; more timesteps make it keep fewer states each
_EMPTY_NOTE: Note = {}
_ERROR_FIELDS = ("final", "mean", "peak", "estimate", "final_estimate", "mean_estimate")


class _ComparisonTimes(NamedTuple):
    """Times [s] of restarts of a run from its reference's state, if any, and of comparisons."""

    begins: Floats
    ends: Floats


def reference_families(
    models: Mapping[str, RunSpec],
    scene: Scene,
    controls: Mapping[str, str | None] = MappingProxyType({}),
) -> list[list[str]]:
    """Return run ids grouped by their reference, that is, by their models without numerics.

    `controls` are hashes of the actions of policies in runs, by id; a reference repeats them.
    """
    families: dict[tuple[str, str | None], list[str]] = {}
    for run_id, model in models.items():
        shared = scene.run_id(with_reference_numerics(model, "RK4", 1.0))
        families.setdefault((shared, controls.get(run_id)), []).append(run_id)
    return list(families.values())


def reference_steps(
    refine: int, runs: Mapping[str, RunSpec], models: Mapping[str, RunSpec], scene: Scene
) -> float:
    """Return the number of force evaluations to compare runs with references, of `models`."""
    return sum(
        _evaluation_count([runs[run_id] for run_id in family], models[family[0]], refine)
        for family in reference_families(models, scene)
    )


def _evaluation_count(family: list[RunSpec], model: RunSpec, refine: int) -> float:
    finest = max(run.duration / run.timestep for run in (*family, model))
    evaluations_per_step = 4  # of RK4
    # The coarse solution, its perturbed copy, and the fine one with twice as many steps.
    reference = 4 * refine * finest * evaluations_per_step
    return reference + sum(run.steps for run in family)


def discretization_errors(
    scene: Scene,
    family: Sequence[PlannedModel],
    model: RunSpec,
    request: AccuracyRequest,
    watch: Watch,
) -> list[Note]:
    """Return a note for each run of a family, with every kind of error that the sweep may choose.

    `model` is that of their reference; `watch` is called before steps, to start their time limit.
    """
    local = request.error == "local"
    timesteps = [run.run.timestep for run in family]
    # More timesteps in a family leave memory for fewer states of each.
    states = family[0].prepared.model
    bytes_of_state = 8 * (1 + states.nq + states.nv + states.na)
    least, most = 16, 256  # common times of a run and its reference
    fitting = _MOST_BYTES_OF_STATES // (bytes_of_state * len(set(timesteps)))
    samples, shared = max(least, min(most, fitting)), request.against == "written"
    times = [
        _restart_times(run, max(timesteps))
        if local
        else _common_times(run, samples, to_the_end=shared)
        for run in family
    ]
    needed = np.unique(np.concatenate([part for family_times in times for part in family_times]))
    solved = Family(scene, family[0], model, watch)
    reference = solved.find_reference(needed, min(*timesteps, model.timestep) / request.refine)
    if reference is None:
        return [{} for _ in family]
    compare = _compare_locally if local else _compare_whole
    notes = [
        compare(reference, run, run_times) for run, run_times in zip(family, times, strict=True)
    ]
    shared_fields: dict[str, object] = {
        "integrator": reference.integrator,
        "timestep": reference.timestep,
    }
    if not local:
        shared_fields["divergence"] = divergence = reference.chaos_divergence()
        errors = [note["trajectory"] for note in notes if note]
        if divergence is None or not errors:
            shared_fields["chaotic"] = None
        else:
            # A family is chaotic if a start 1e-8 away diverges by a visible share of the model's
            # extent, and by as much as the runs' errors or as the reference's own estimate shows.
            extent_share, error_share, estimate_multiple = 1e-3, 0.1, 10.0
            peaks = [error["peak"] for error in errors]
            hides_errors = divergence >= error_share * float(np.median(peaks))
            above_estimate = divergence >= estimate_multiple * errors[0]["estimate"]
            visible = divergence >= extent_share * float(reference.fine.prepared.model.stat.extent)
            shared_fields["chaotic"] = visible and (hides_errors or above_estimate)
    return [{**note, **shared_fields} for note in notes]


def _common_times(run: PlannedModel, samples: int, *, to_the_end: bool) -> _ComparisonTimes:
    """Return times of a run's own steps or, with `to_the_end`, times without a timestep."""
    resolved = run.run
    if to_the_end:
        return _ComparisonTimes(np.empty(0), np.linspace(0, resolved.duration, samples + 1)[1:])
    return _ComparisonTimes(
        np.empty(0), resolved.timestep * _spread_numbers(1, resolved.steps, samples)
    )


def _restart_times(run: PlannedModel, longest: float) -> _ComparisonTimes:
    """Spread restarts over a run, each over the family's longest timestep."""
    total, timestep = run.run.steps, run.run.timestep
    steps = min(total, max(1, round(longest / timestep)))
    most_restarts = 32
    begins = _spread_numbers(0, total - steps, most_restarts)
    return _ComparisonTimes(timestep * begins, timestep * (begins + steps))


def _spread_numbers(first: int, last: int, most: int) -> Floats:
    """Return whole numbers from first to last, evenly spread if there are too many."""
    numbers = np.linspace(first, last, min(last - first + 1, most), dtype=np.float64)
    return np.unique(numbers.round())


def _compare_whole(
    reference: ReferenceSolution, run: PlannedModel, times: _ComparisonTimes
) -> Note:
    sampled = reference.family.integrate_model(run.prepared, times.ends, run.start)
    if sampled is None:
        return {}
    rows, coarse = reference.rows_at(times.ends), reference.coarse.sampled
    return {
        "trajectory": _error_summary(
            reference.state_distance(sampled, rows), reference.state_distance(coarse)
        ),
        "invariants": _error_summary(
            reference.invariant_drift(sampled, rows), reference.invariant_drift(coarse)
        ),
        "velocity": reference.velocity_distance(sampled, rows),
        "impacts": sampled.impacts,
    }


def _compare_locally(
    reference: ReferenceSolution, run: PlannedModel, times: _ComparisonTimes
) -> Note:
    """Compare a run's model with its reference, restarted from many of the reference's states."""
    whole = reference.family.integrate_model(run.prepared, times.ends[-1:], run.start)
    error = reference.local_error(run.prepared, *times)
    own = reference.local_error(reference.coarse.prepared, *times)
    if whole is None or error is None or own is None:
        return {}
    return {"local": _error_summary(error, own), "impacts": whole.impacts}


def _error_summary(error: Discrepancy, own: Discrepancy) -> dict[str, float]:
    own_errors = {"estimate": own.peak, "final_estimate": own.final, "mean_estimate": own.mean}
    return error._asdict() | own_errors


def run_accuracies(
    request: AccuracyRequest,
    scene: Scene,
    runs: Mapping[str, RunSpec],
    notes: Mapping[str, Note],
) -> dict[str, Accuracy]:
    """Return the accuracy of every run, by run id, from the notes of the pass."""
    # One kind of error for all runs, because different kinds cannot be compared.
    if request.error != "auto":
        kind = request.error
    else:
        chaotic_flags = [
            note["chaotic"] for note in notes.values() if note.get("chaotic") is not None
        ]
        kind = "invariants" if sum(chaotic_flags) > len(chaotic_flags) / 2 else "trajectory"
    rules = solref_rules(runs)
    accuracies: dict[str, Accuracy] = {}
    for run_id, resolved in runs.items():
        note = notes.get(run_id, _EMPTY_NOTE)
        error = note.get(kind, _EMPTY_NOTE)
        prepared = scene.base_of(resolved).prepare(resolved.list_edits())
        solrefs = [pair.solref for pair in prepared.pairs.values()]
        accuracies[run_id] = Accuracy(
            **{f"error_{name}": error.get(name) for name in _ERROR_FIELDS},
            error_velocity=note.get("velocity"),
            error_energy=note.get("invariants", _EMPTY_NOTE).get("mean"),
            error_kind=kind,
            chaotic=note.get("chaotic"),
            divergence=note.get("divergence"),
            reference_integrator=note.get("integrator"),
            reference_timestep=note.get("timestep"),
            impacts=note.get("impacts"),
            solref_rule=rules[run_id],
            solref_clamped=resolved.flags["refsafe"]
            and any(refsafe_solref(solref, resolved.timestep) != solref for solref in solrefs),
        )
    return accuracies


def solref_rules(runs: Mapping[str, RunSpec]) -> dict[str, SolrefRule | None]:
    """Return how solref relates to the timestep among otherwise equal runs, by run id.

    It is tied if the time constant is the same multiple of every timestep, otherwise absolute; None
    if the timestep does not vary.
    """
    groups: dict[str, list[str]] = {}
    for run_id, run in runs.items():
        values = {name: run.values[name] for name in run.values.keys() - {"timestep", "solref"}}
        shared = (sorted(values.items()), sorted(run.flags.items()), run.seed, run.duration)
        groups.setdefault(repr(shared), []).append(run_id)
    rules: dict[str, SolrefRule | None] = {}
    for run_ids in groups.values():
        rules |= dict.fromkeys(run_ids, _solref_rule([runs[run_id] for run_id in run_ids]))
    return rules


def _solref_rule(runs: Sequence[RunSpec]) -> SolrefRule | None:
    if len({run.timestep for run in runs}) == 1:
        return None
    solrefs = [run.settings.get("solref") for run in runs]
    multiples = [
        float(solref[0]) / run.timestep if isinstance(solref, tuple) else 0.0
        for run, solref in zip(runs, solrefs, strict=True)
    ]
    least, most = min(multiples), max(multiples)
    return "tied" if least > 0 and most - least <= SUM_ROUNDING * most else "absolute"
