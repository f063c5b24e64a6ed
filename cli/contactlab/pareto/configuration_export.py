"""Exports a configuration as a sweep file that repeats it from fresh seeds."""

import json
from collections.abc import Sequence
from pathlib import Path

from contactlab import resources
from contactlab.errors import StoreError
from contactlab.schema.evidence import ERRORS, Setting
from contactlab.schema.sweep_schema import Sweep
from contactlab.schema.tradeoff_report import TradeoffReport
from contactlab.store.finished_store import Store

FRESH_SEEDS = 10
_MANIFEST_NAME = "scene.yaml"


def recommended_sweep(
    store: Store, report: TradeoffReport, folder: Path, seeds: int = FRESH_SEEDS
) -> str:
    """Return a sweep file of the recommended configuration, in every scenario of its sweep.

    Its tolerances of metrics are expectations, so that `contactlab sweep` exits with 1 if one is
    exceeded, or if a run gets a failure label. Errors against a reference are not metrics;
    `contactlab tradeoff` checks whether they are within tolerance again. Times are omitted. The
    scene's path is relative to the file's folder; none of its seeds is in the store.
    """
    assert report.recommendation is not None
    resolved, metrics = store.manifest.sweep.resolved, store.manifest.sweep.metric_versions
    sweep = Sweep.model_validate(resolved)
    chosen = report.recommendation.configuration
    first = 1 + max(store.columns.to_pydict(["seed"])["seed"])
    knobs = {name: [value] for name, value in chosen.items() if name not in sweep.effects}
    # The axes of scenarios, with the values of the sweep's runs.
    columns = store.columns.to_pydict(report.scenarios)
    rows = dict.fromkeys(zip(*columns.values(), strict=True))
    settings: Sequence[tuple[Setting, ...]] = list(zip(*rows, strict=True))
    blocks = {
        name: {"values": list(value), "role": "scenario"}
        for name, value in zip(report.scenarios, settings, strict=True)
    }
    bounds = {
        name: {"min": -limit, "max": limit}
        for name, limit in report.tolerances.items()
        if name in metrics
    }
    expectation = {
        "label": "stable",
        **({"metrics": bounds} if bounds else {}),
        "reason": "the configuration was feasible in every run that recommended it",
    }
    axes = {name: values for name, values in knobs.items() if values != [None]}
    content: dict[str, object] = {
        "version": 1,
        "scene": _scene_reference(store, sweep.scene, folder),
        "description": f"Recommendation of {report.sweep}, from fresh seeds",
        "duration": sweep.duration,
        "seeds": list(range(first, first + seeds)),
        "axes": {**axes, **(blocks if len(blocks) == 1 else {})},
        "zip": [blocks] if len(blocks) > 1 else None,
        "effects": {name: chosen.get(name, effect) for name, effect in sweep.effects.items()},
        "thresholds": sweep.thresholds,
        "accuracy": resolved.get("accuracy") if set(ERRORS) & report.tolerances.keys() else None,
        "tolerances": {
            name: tolerance
            for name, tolerance in report.tolerances.items()
            if name in {*metrics, *ERRORS}
        },
        "expect": [expectation],
        "trace": "none",
        "checks": sweep.checks,
        "latency_budget": sweep.latency_budget,
    }
    # YAML with values in JSON, one key per line, without empty values.
    lines = [f"# Chosen among {len(report.configurations)} configurations of {report.store}."]
    for name, value in content.items():
        if value in (None, {}, []):
            continue
        if name in {"axes", "tolerances"} and isinstance(value, dict):
            lines.append(f"{name}:")
            lines += [f"  {key}: {json.dumps(setting)}" for key, setting in value.items()]
        elif isinstance(value, list) and name != "seeds":
            lines.append(f"{name}:")
            lines += [f"  - {json.dumps(item)}" for item in value]
        else:
            lines.append(f"{name}: {json.dumps(value)}")
    return "\n".join(lines) + "\n"


def _scene_reference(store: Store, reference: str, folder: Path) -> str:
    """Return the scene's name or, relative to a folder, the path of the store's copy."""
    if reference in resources.scene_names() or ":" in reference:
        return reference
    if not isinstance(store.address, Path):
        raise StoreError(
            f"the scene '{reference}' is stored in {store.address} only; copy the store to a "
            "folder "
            "and analyze it there, so that the sweep file can name the scene"
        )
    manifest = next(store.scene_folder.rglob(_MANIFEST_NAME), None)
    model = store.scene_folder / store.manifest.sweep.scene_model
    path = (manifest.parent if manifest else model).resolve()
    base = folder.resolve()
    return f"./{path.relative_to(base)}" if path.is_relative_to(base) else str(path)
