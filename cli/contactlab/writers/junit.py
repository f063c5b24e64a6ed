"""A report as JUnit XML: a test case for each finding."""

import re
from collections.abc import Sequence
from xml.etree import ElementTree as ET

from contactlab.judge.wording import pairs_in_words
from contactlab.printable import printable
from contactlab.schema.finding import Finding
from contactlab.writers.report import Report

# XML cannot represent these characters, not even escaped.
_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def as_junit(report: Report) -> str:
    """Return a report as JUnit XML; a warning or a note is passed, with an output."""
    cases = [_build_test_case(finding, report) for finding in report.findings]
    root = ET.Element("testsuites")
    attributes = {
        "name": _clean_text(report.title),
        "tests": str(len(cases)),
        "failures": str(sum(case.find("failure") is not None for case in cases)),
        "errors": "0",
        "skipped": str(sum(case.find("skipped") is not None for case in cases)),
        "time": "0",
    }
    suite = ET.SubElement(root, "testsuite", attributes)
    suite.extend(cases)
    head = [report.headline, *(f"{name}: {text}" for name, text in report.facts)]
    ET.SubElement(suite, "system-out").text = _join_lines(head)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _build_test_case(finding: Finding, report: Report) -> ET.Element:
    place = ("contactlab", *report.place, finding.kind, finding.group)
    # Readers split the class name at its dots.
    classname = _clean_text(".".join(part.replace(".", "_") for part in place if part))
    case = ET.Element("testcase", name=_clean_text(finding.name), classname=classname, time="0")
    message = f"{finding.verdict}: {finding.full_message}"
    details = list(pairs_in_words(finding))
    if finding.outcome == "failed":
        failure = ET.SubElement(case, "failure", message=_clean_text(message), type=finding.verdict)
        failure.text = _join_lines([message, *details, *report.command_lines])
    elif finding.outcome == "skipped":
        ET.SubElement(case, "skipped", message=_clean_text(message))
    elif finding.outcome != "passed":
        output = [f"{finding.outcome}: {message}", *details]
        ET.SubElement(case, "system-out").text = _join_lines(output)
    return case


def _join_lines(texts: Sequence[str]) -> str:
    return _clean_text("\n".join(texts))


def _clean_text(text: str) -> str:
    return _FORBIDDEN.sub("?", printable(text))
