"""JSON Schemas of the models; as draft-07, which editors check best, where people write them."""

import json
from collections.abc import Mapping
from typing import cast

from pydantic import BaseModel

from contactlab.plugins import find_extensions
from contactlab.schema.advisory import Advisory
from contactlab.schema.advisory_report import AdvisoriesCheck
from contactlab.schema.check_report import Reference
from contactlab.schema.comparison import ComparePolicy, ComparisonReport
from contactlab.schema.diff_report import DiffReport
from contactlab.schema.differences_report import DifferencesReport
from contactlab.schema.effects_report import EffectsReport
from contactlab.schema.engine_panel import EnginePanel
from contactlab.schema.error_budget import BudgetReport
from contactlab.schema.evidence import EvidenceRecord, StoreManifest
from contactlab.schema.examination import Examination
from contactlab.schema.gradients import GradientsReport
from contactlab.schema.grip import GripReport
from contactlab.schema.lint_report import LintReport
from contactlab.schema.scene_manifest import SceneManifest
from contactlab.schema.shrink_report import ShrinkReport
from contactlab.schema.study_reports import FitReport
from contactlab.schema.success import SuccessReport
from contactlab.schema.sweep_schema import Sweep
from contactlab.schema.tradeoff_report import TradeoffReport
from contactlab.schema.tune_report import TuneReport

# Files that people write, for editors; a key without a value is left out of these.
WRITTEN: Mapping[str, type[BaseModel]] = {
    "sweep.schema.json": Sweep,
    "scene.schema.json": SceneManifest,
    "policy.schema.json": ComparePolicy,
    "advisory.schema.json": Advisory,
}
# Files that contactlab writes, for programs; null says that something does not apply.
EMITTED: Mapping[str, type[BaseModel]] = {
    "record.schema.json": EvidenceRecord,
    "manifest.schema.json": StoreManifest,
    "tradeoff.schema.json": TradeoffReport,
    "comparison.schema.json": ComparisonReport,
    "budget.schema.json": BudgetReport,
    "examination.schema.json": Examination,
    "lint.schema.json": LintReport,
    "diff.schema.json": DiffReport,
    "reference.schema.json": Reference,
    "effects.schema.json": EffectsReport,
    "tune.schema.json": TuneReport,
    "fit.schema.json": FitReport,
    "gradients.schema.json": GradientsReport,
    "engine-panel.schema.json": EnginePanel,
    "grip.schema.json": GripReport,
    "shrink.schema.json": ShrinkReport,
    "success.schema.json": SuccessReport,
    "advisories-check.schema.json": AdvisoriesCheck,
    "advisories-find.schema.json": DifferencesReport,
}

Node = dict[str, object]
_DRAFT_07 = "http://json-schema.org/draft-07/schema#"
_DRAFT_2020 = "https://json-schema.org/draft/2020-12/schema"
_NULL: Node = {"type": "null"}
_RENAMED = {"prefixItems": "items", "$defs": "definitions"}


def json_schemas() -> dict[str, Node]:
    """Return the JSON Schema of every exchanged file, by file name."""
    schemas: dict[str, Node] = {}
    for name, model in WRITTEN.items():
        schemas[name] = {"$schema": _DRAFT_07, **_rewrite_node(model.model_json_schema())}
    others = {
        f"{name}.schema.json": extension.load()
        for name, extension in find_extensions("schema").items()
    }
    for name, model in {**EMITTED, **others}.items():
        schemas[name] = {"$schema": _DRAFT_2020, **model.model_json_schema(mode="serialization")}
    return schemas


def schema_texts() -> dict[str, str]:
    """Return the text of every published schema, by file name."""
    return {name: json.dumps(schema, indent=2) + "\n" for name, schema in json_schemas().items()}


def _rewrite_node(schema: Mapping[str, object]) -> Node:
    """Rewrite one schema of draft 2020-12 in terms of draft-07, which editors understand.

    Tuples become `items` lists, "or null" branches go (a key is left out instead), and generated
    titles go. The values of `properties` and `$defs` are schemas by free names.
    """
    node: Node = {}
    for key, value in schema.items():
        if key in {"title", "discriminator"} or (key == "default" and value is None):
            continue
        if key in {"properties", "$defs"}:
            named_parts = cast("Mapping[str, Mapping[str, object]]", value)
            node[_RENAMED.get(key, key)] = {
                name: _rewrite_node(part) for name, part in named_parts.items()
            }
        elif key not in {"default", "const", "enum", "examples"}:
            node[_RENAMED.get(key, key)] = _rewrite_part(value)
        else:
            node[key] = value
    branches = node.get("anyOf")
    if isinstance(branches, list) and _NULL in branches:
        concrete = [cast("Node", branch) for branch in branches if branch != _NULL]
        rest = {key: value for key, value in node.items() if key != "anyOf"}
        node = {**concrete[0], **rest} if len(concrete) == 1 else {**rest, "anyOf": concrete}
    # Draft-07 ignores siblings of a reference, so they move into `allOf`.
    if "$ref" not in node or len(node) == 1:
        return node
    rest = {key: value for key, value in node.items() if key != "$ref"}
    return {"allOf": [{"$ref": node["$ref"]}], **rest}


def _rewrite_part(value: object) -> object:
    if isinstance(value, Mapping):
        return _rewrite_node(cast("Mapping[str, object]", value))
    if isinstance(value, list):
        return [_rewrite_part(part) for part in cast("list[object]", value)]
    if isinstance(value, str):
        return value.replace("#/$defs/", "#/definitions/")
    return value
