"""A comparison as JUnit XML: one case a check, the same ones every time."""

import re
from collections.abc import Sequence
from xml.etree import ElementTree as ET

from contactlab.compare.told import found, name, values, where
from contactlab.schema import Check, ComparisonReport

# XML has no way to write these, not even escaped.
_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def as_junit(report: ComparisonReport) -> str:
    """Return a comparison as JUnit XML.

    Warnings and notes are passed cases that say so in `system-out`; what cannot be compared is
    skipped, and skipping what must be comparable is an error of the case that says so.
    """
    sweep = "stores" if report.baseline is None else report.baseline.sweep
    suite = ET.Element("testsuite", name=_clean(f"contactlab compare {sweep}"))
    for check in report.checks:
        suite.append(_case(check, sweep, report.advice))
    outcomes = [check.outcome for check in report.checks]
    suite.set("tests", str(len(outcomes)))
    suite.set("failures", str(outcomes.count("failed")))
    suite.set("errors", "0")
    suite.set("skipped", str(outcomes.count("skipped")))
    suite.set("time", "0")
    root = ET.Element("testsuites")
    root.append(suite)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _case(check: Check, sweep: str, advice: Sequence[str]) -> ET.Element:
    # Readers split the class name at its dots.
    parts = ("contactlab", sweep, check.kind, *filter(None, [check.group]))
    case = ET.Element(
        "testcase",
        name=_clean(check.name),
        classname=_clean(".".join(part.replace(".", "_") for part in parts)),
        time="0",
    )
    message = _clean(f"{check.verdict}: {found(check)}")
    if check.outcome == "failed":
        failure = ET.SubElement(case, "failure", message=message, type=check.verdict)
        failure.text = _clean("\n".join([message, *_pairs(check), *advice]))
    elif check.outcome == "skipped":
        ET.SubElement(case, "skipped", message=message)
    elif check.outcome != "passed":
        told = "\n".join([f"{check.outcome}: {message}", *_pairs(check)])
        ET.SubElement(case, "system-out").text = _clean(told)
    return case


def _pairs(check: Check) -> list[str]:
    return [
        f"{name(check)}: {values(check, pair)} at {where(pair)}".replace(":  at", ": at")
        for pair in check.worst
    ]


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("?", text)
