"""A report as SARIF 2.1.0, which code scanning and editors read.

Source: the OASIS standard "Static Analysis Results Interchange Format (SARIF) Version 2.1.0".
"""

import json
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from urllib.parse import quote

from contactlab.printable import printable, visible
from contactlab.schema.finding import SEVERITIES, Finding, PlacedFinding
from contactlab.writers.report import Report

_SCHEMA = "https://json.schemastore.org/sarif-2.1.0.json"
_NOT_SHOWN = ("passed", "skipped")
Node = dict[str, object]


def as_sarif(report: Report) -> str:
    """Return a report as SARIF: a result for each finding; waived ones are suppressed."""
    findings = [finding for finding in report.findings if finding.outcome not in _NOT_SHOWN]
    rules = {finding.name: _index_of_rule(finding, report.rules) for finding in findings}
    places = {name: place for place, name in enumerate(rules)}
    driver = {"name": "contactlab", "version": version("contactlab"), "rules": [*rules.values()]}
    results = [_result_of_finding(finding, places[finding.name]) for finding in findings]
    run = {"tool": {"driver": driver}, "columnKind": "unicodeCodePoints", "results": results}
    log = {"$schema": _SCHEMA, "version": "2.1.0", "runs": [run]}
    return printable(json.dumps(log, indent=2, ensure_ascii=False)) + "\n"


def _index_of_rule(finding: Finding, rules: Mapping[str, str]) -> Node:
    about = rules.get(finding.name, finding.name)
    rule: Node = {"id": finding.name, "shortDescription": {"text": visible(about)}}
    if isinstance(finding, PlacedFinding) and finding.docs:
        rule["help"] = {"text": finding.docs}
    return {**rule, "defaultConfiguration": {"level": SEVERITIES[finding.level]}}


def _result_of_finding(finding: Finding, rule: int) -> Node:
    texts = [finding.message, *(finding.fix if isinstance(finding, PlacedFinding) else ())]
    result: Node = {
        "ruleId": finding.name,
        "ruleIndex": rule,
        "level": SEVERITIES[finding.level],
        "message": {"text": visible("\n".join(texts))},
    }
    if isinstance(finding, PlacedFinding):
        file = Path(finding.file)
        place = {
            "artifactLocation": {
                "uri": file.as_uri() if file.is_absolute() else quote(file.as_posix())
            },
            "region": {"startLine": finding.line},
        }
        result["locations"] = [{"physicalLocation": place}]
    if finding.waived is not None:
        suppression = {"kind": "inSource", "justification": visible(finding.waived)}
        result["suppressions"] = [suppression]
    return result
