"""The one place that knows the names of the package's facts.

A guard compares results. If a field of a report is renamed, its new name is written here, and the
records stay as they are. Names that are stored in files (of runs, metrics, settings) are read as
they are stored: they may not change.
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from tests.guards.records import Facts

if TYPE_CHECKING:
    from contactlab.schema.error_budget import BudgetPhase, BudgetRow
    from contactlab.schema.evidence import EvidenceRecord, SweepIdentity
    from contactlab.schema.examination import Examination, Fix, RunLabel
    from contactlab.schema.tune_report import Candidate, TuneReport
    from contactlab.store.finished_store import Store

EVIDENCE_TOPIC = "/evidence"
_REASONS = ("reason", "reasons")  # how the names of sentences end
# Facts that clock, machine and version decide.
_UNSTEADY = {"cost", "started", "finished", "provenance", "timing"}
# Versions of metrics stand in the records; the text of a sweep's file is in the repository.
_UNSTEADY_IDENTITY = {"definitions", "engine", "metric_versions", "source"}
_OUTCOMES = {"runs", "labels", "statuses", "traces", "expectations", "unmet_means"}


def run_name(sweep: str, axes: Mapping[str, object], seed: int) -> str:
    """Return the name of a run: its sweep, its settings, and its seed unless that is 0."""
    values = [f"{name}={_value_text(value)}" for name, value in axes.items()]
    return " ".join([f"{sweep}:", *values, *([f"seed={seed}"] if seed or not values else [])])


def _value_text(value: object) -> str:
    if isinstance(value, list | tuple):
        return f"({', '.join(map(_value_text, value))})"
    return f"{value:.15g}" if isinstance(value, float) else str(value)


def planned_facts(identity: "SweepIdentity") -> Facts:
    """Return the facts of a planned sweep."""
    return nested_facts(identity.model_dump(mode="json", exclude=_UNSTEADY_IDENTITY))


def stored_facts(store: "Store") -> Facts:
    """Return the outcomes of a store, and the columns of its table."""
    outcome = store.manifest.model_dump(mode="json", include=_OUTCOMES)
    described = store.columns.described.values()
    columns = {column.name: f"{column.type} [{column.unit}]" for column in described}
    return {**nested_facts(outcome), "columns": columns}


def run_facts(record: "EvidenceRecord") -> Facts:
    """Return the facts of a run that neither clock, machine nor version decides."""
    return nested_facts(lasting_facts(record.model_dump(mode="json")))


def lasting_facts(record: Mapping[str, Any]) -> Facts:
    """Return the facts of a record in JSON that neither clock, machine nor version decides."""
    facts = {name: fact for name, fact in record.items() if name not in _UNSTEADY}
    if facts.get("trace"):
        facts["trace_file"] = {name: facts["trace"][name] for name in ("file", "messages")}
    facts.pop("trace", None)
    # An engine of contactlab's own has its version.
    if facts["engine"]["version"] == record["provenance"]["contactlab"]:
        facts["engine"] = {"name": facts["engine"]["name"]}
    return facts


def is_sentence(name: str, value: object) -> bool:
    """Whether a fact of a run is a sentence: the reason of a label, of an effect or the like."""
    del value
    return name.endswith(_REASONS)


def parted(facts: Mapping[str, Any], is_word: Callable[[str, object], bool]) -> tuple[Facts, Facts]:
    """Return facts without their words, and the words, which a name and a value tell."""
    results, words = Facts(), Facts()
    for name, value in facts.items():
        if is_word(name, value):
            words[name] = value
        elif isinstance(value, Mapping) and value:
            inner, said = parted(value, is_word)
            results |= {name: inner} if inner else {}
            words |= {name: said} if said else {}
        else:
            results[name] = value
    return results, words


def trace_versions(metadata: Mapping[str, str]) -> Facts:
    """Return the metadata of a trace without the version of contactlab."""
    ours = f" {metadata['contactlab']}"
    return {
        name: text.removesuffix(ours)
        for name, text in sorted(metadata.items())
        if name != "contactlab"
    }


def nested_facts(data: Mapping[str, Any]) -> Facts:
    """Return nested data with its lists of mappings as mappings by place."""
    return {str(name): _nested(value) for name, value in data.items()}


def _nested(value: Any) -> Any:
    if isinstance(value, Mapping):
        return nested_facts(value)
    if isinstance(value, list | tuple):
        if any(isinstance(one, Mapping | list | tuple) for one in value):
            return {str(place): _nested(one) for place, one in enumerate(value, 1)}
        return [*value]
    return value


def examination_facts(report: "Examination") -> tuple[Facts, Facts]:
    """Return the verdict, labels and shares of a model, and the sentences about them."""
    budget = report.budget
    results: Facts = {
        "verdict": budget.verdict if budget else None,
        "verdict of runs": report.task_verdict.verdict if report.task_verdict else None,
        "good": report.passed,
        "task": {
            "duration": report.task.duration,
            "seeds": [*report.task.seeds],
            "phases": {phase.name: phase.begin for phase in report.task.phases},
        },
        "labels": {label.label: _label_facts(label) for label in report.labels},
        "reasons": {
            str(place): _picked(reason, _OF_REASONS)
            for place, reason in enumerate(budget.reasons if budget else (), 1)
        },
        "phases": {phase.name: _phase_facts(phase) for phase in (budget.phases if budget else ())},
    }
    words: Facts = {
        "headline": report.headline,
        "why": [*report.why],
        "fix": report.fix,
        "labels": {label.label: label.reason for label in report.labels},
        "reasons": [reason.sentence for reason in (budget.reasons if budget else ())],
    }
    return results, words


_OF_REASONS = {
    "verdict": "verdict",
    "phase": "phase",
    "row": "row",
    "share": "error",
    "body": "body",
    "place": "place",
    "time": "time",
}
_OF_ROWS = {
    "kind": "kind",
    "share": "error",
    "seeds": "seeds",
    "median": "median",
    "by mass": "by_mass",
    "body": "body",
    "place": "place",
    "speed": "speed",
    "seed": "seed",
    "time": "time",
}
_OF_PHASES = {
    "timestep": "timestep",
    "steps": "steps",
    "seeds": "seeds",
    "window": "window",
    "energy": "energy_drift",
    "excess": "excess_path",
    "peak": "worst_window",
    "most": "upper_bound",
    "limit": "limit_factor",
    "lost": "invalid_windows",
}
_OF_LABELS = {
    "phase": "phase",
    "runs": "runs",
    "seed": "seed",
    "time": "time",
    "bodies": "bodies",
}
"""Facts of records, and the fields of reports that hold them."""


def _picked(report: object, fields: Mapping[str, str]) -> Facts:
    return {name: _plain(getattr(report, field)) for name, field in fields.items()}


def _plain(value: Any) -> Any:
    return [*value] if isinstance(value, tuple) else value


def _label_facts(label: "RunLabel") -> Facts:
    return _picked(label, _OF_LABELS)


def _phase_facts(phase: "BudgetPhase") -> Facts:
    rows = {row.name: _row_facts(row) for row in (phase.numerical_error, *phase.rows)}
    return {**_picked(phase, _OF_PHASES), "rows": rows}


def _row_facts(row: "BudgetRow") -> Facts:
    if not row.exercised:
        return {"kind": row.kind, "used": False}
    return _picked(row, _OF_ROWS) | ({"infinite": True} if row.infinite else {})


def change_facts(report: "Examination") -> tuple[Facts, Facts]:
    """Return the changes that an examination recommends, and the sentences about them."""
    results: Facts = {
        "verdict": report.budget.verdict if report.budget else None,
        "changes": {change.name: _change_facts(change) for change in report.fixes},
        "no time for": [*report.not_tried],
    }
    words = {
        "headline": report.headline,
        "names": {change.name: change.apply for change in report.fixes if change.apply},
        "notes": [*report.notes],
    }
    return results, words


def tune_facts(report: "TuneReport") -> tuple[Facts, Facts]:
    """Return what a search recommends, and the sentences about it."""
    others = {"as accurate": report.equal_error}
    results: Facts = {
        "aim": {
            "kind": report.target.kind,
            "limit": report.target.limit,
            "unit": report.target.unit,
        },
        "met": report.target_met,
        "as written": _point_facts(report.current),
        "verdict": report.current_verdict.verdict if report.current_verdict else None,
        "recommended": _point_facts(report.recommended) if report.recommended else None,
        "front": {
            str(point.number): [point.name, [*point.marks], point.state] for point in report.front
        },
        "others": {name: _point_facts(one.candidate) for name, one in others.items() if one},
        "changes": {
            change.name: [change.before, change.after] for change in report.changed_settings
        },
        "cannot touch": {"geoms": [*report.masked], "bodies": _nested(report.excluded)},
        "flags": [*report.disabled_flags],
        "tried": len(report.candidates),
        "ended early": report.ended == "time",
        "verified": report.verified.holds if report.verified else None,
        "not changed": [one.name for one in report.not_changed],
    }
    words: Facts = {
        "sentence": report.sentence,
        "verified": report.verified.sentence if report.verified else "",
        "not changed": {one.name: one.reason for one in report.not_changed},
        "limiting factor": report.limiting_factor,
    }
    return results, words


_OF_CHANGES = {
    "another model": "changes_model",
    "removes": "removes",
    "share": "error",
    "apart": "distance_to_reference",
    "before": "distance_before",
    "freed": "added_free_joints",
}
_OF_POINTS = {"timestep": "timestep", "error": "error", "body": "body", "phase": "phase"}


def _change_facts(change: "Fix") -> Facts:
    facts = _picked(change, _OF_CHANGES) | {"settings": nested_facts(change.settings)}
    return facts | {
        "excluded": _nested(change.excluded_pairs),
        "fitted": _nested(change.replaced_meshes),
        "posed": _nested(change.changed_keyframes),
        "placed": _nested(change.moved_bodies),
        "masked": _nested(change.masked_geoms),
        "cost": change.time_ratio and change.time_ratio.ratio,
    }


def _point_facts(point: "Candidate") -> Facts:
    facts = _picked(point, _OF_POINTS) | {"settings": nested_facts(point.settings)}
    return facts | {"cost": point.time_ratio and point.time_ratio.ratio}
