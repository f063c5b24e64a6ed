"""The one place that knows what the package calls its facts.

A guard compares results. If a field of a report is renamed, its new name is written here, and the
records stay as they are. Names that are stored in files (of runs, metrics, settings) are read as
they are stored: they may not change.
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from tests.guards.records import Facts

if TYPE_CHECKING:
    from contactlab.schema.evidence import EvidenceRecord, SweepIdentity
    from contactlab.store.finished_store import Store

EVIDENCE_TOPIC = "/evidence"
_REASONS = ("reason", "reasons")  # how the names of sentences end
# What clock, machine and version decide.
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
