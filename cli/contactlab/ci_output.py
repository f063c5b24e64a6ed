"""The checks of a command for CI jobs: JUnit XML, and annotations of GitHub."""

import re
from collections.abc import Iterator, Sequence
from xml.etree import ElementTree as ET

from contactlab.printable import visible
from contactlab.schema.comparison import JudgedCheck

_MOST_ANNOTATIONS_OF_A_STEP = (
    9  # a step shows ten errors and ten warnings, and silently drops the others
)
# XML cannot represent these characters, not even escaped.
_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def junit_case(
    check: JudgedCheck, place: Sequence[str], verdict: str, details: Sequence[str] = ()
) -> ET.Element:
    """Return a check as a test case in JUnit XML; a warning or a note is passed, with an output.

    The verdict is a word, the details are lines. The place has the parts of its class name, after
    the program's; empty ones are left out.
    """
    # Readers split the class name at its dots.
    parts = (part.replace(".", "_") for part in ("contactlab", *place) if part)
    name, classname = _clean(check.name), _clean(".".join(parts))
    case = ET.Element("testcase", name=name, classname=classname, time="0")
    message = _clean(f"{verdict}: {check.full_message}")
    if check.outcome == "failed":
        failure = ET.SubElement(case, "failure", message=message, type=_clean(verdict))
        failure.text = _clean("\n".join([message, *details]))
    elif check.outcome == "skipped":
        ET.SubElement(case, "skipped", message=message)
    elif check.outcome != "passed":
        output = "\n".join([f"{check.outcome}: {message}", *details])
        ET.SubElement(case, "system-out").text = _clean(output)
    return case


def junit(title: str, cases: Sequence[ET.Element]) -> str:
    """Return the test cases of a command as JUnit XML."""
    root = ET.Element("testsuites")
    told = {
        "name": _clean(title),
        "tests": str(len(cases)),
        "failures": str(sum(case.find("failure") is not None for case in cases)),
        "errors": "0",
        "skipped": str(sum(case.find("skipped") is not None for case in cases)),
        "time": "0",
    }
    ET.SubElement(root, "testsuite", told).extend(cases)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("?", visible(text))


def annotations(title: str, errors: Sequence[str], warnings: Sequence[str]) -> str:
    """Return the annotations of errors and warnings: 9 of each, and how many more."""
    lines = [*_annotations("error", title, errors), *_annotations("warning", title, warnings)]
    return "".join(f"{line}\n" for line in lines)


def _annotations(command: str, title: str, messages: Sequence[str]) -> Iterator[str]:
    shown = list(messages[:_MOST_ANNOTATIONS_OF_A_STEP])
    if len(messages) > len(shown):
        shown.append(f"and {len(messages) - len(shown):,} more; see the summary")
    titled = _data(title).replace(":", "%3A").replace(",", "%2C")
    for message in shown:
        yield f"::{command} title={titled}::{_data(message)}"


def _data(text: str) -> str:
    return visible(text).replace("%", "%25").replace("\n", "%0A")
