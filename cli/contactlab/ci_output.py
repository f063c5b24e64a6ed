"""The checks of a command for CI jobs: JUnit XML, and annotations of GitHub."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from xml.etree import ElementTree as ET

from contactlab.printable import visible
from contactlab.schema.judged_check import JudgedCheck

_MOST_ANNOTATIONS = 9
"""A step shows ten errors and ten warnings, and silently drops the others."""
# XML cannot represent these characters, not even escaped.
_FORBIDDEN = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(frozen=True)
class JUnitCase:
    """A check as a test case, with its verdict in a word, and lines of details if it fails.

    The place has the parts of its class name, after the program's; empty ones are left out.
    """

    check: JudgedCheck
    place: Sequence[str]
    verdict: str
    details: Sequence[str] = ()

    @property
    def element(self) -> ET.Element:
        """The case as JUnit XML; of warnings and notes, a passed case with a `system-out`."""
        # Readers split the class name at its dots.
        parts = ("contactlab", *filter(None, self.place))
        case = ET.Element(
            "testcase",
            name=_clean(self.check.name),
            classname=_clean(".".join(part.replace(".", "_") for part in parts)),
            time="0",
        )
        outcome = self.check.outcome
        message = _clean(f"{self.verdict}: {self.check.full_message}")
        if outcome == "failed":
            failure = ET.SubElement(case, "failure", message=message, type=_clean(self.verdict))
            failure.text = _clean("\n".join([message, *self.details]))
        elif outcome == "skipped":
            ET.SubElement(case, "skipped", message=message)
        elif outcome != "passed":
            output = "\n".join([f"{outcome}: {message}", *self.details])
            ET.SubElement(case, "system-out").text = _clean(output)
        return case


def junit(title: str, cases: Sequence[JUnitCase]) -> str:
    """Return the checks of a command as JUnit XML."""
    outcomes = [case.check.outcome for case in cases]
    root = ET.Element("testsuites")
    suite = ET.SubElement(
        root,
        "testsuite",
        name=_clean(title),
        tests=str(len(outcomes)),
        failures=str(outcomes.count("failed")),
        errors="0",
        skipped=str(outcomes.count("skipped")),
        time="0",
    )
    suite.extend(case.element for case in cases)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode", xml_declaration=True) + "\n"


def _clean(text: str) -> str:
    return _FORBIDDEN.sub("?", visible(text))


def annotations(title: str, errors: Sequence[str], warnings: Sequence[str]) -> str:
    """Return the annotations of errors and warnings: 9 of each, and how many more."""
    lines = [*_annotations("error", title, errors), *_annotations("warning", title, warnings)]
    return "".join(f"{line}\n" for line in lines)


def _annotations(command: str, title: str, messages: Sequence[str]) -> Iterator[str]:
    shown = list(messages[:_MOST_ANNOTATIONS])
    if len(messages) > len(shown):
        shown.append(f"and {len(messages) - len(shown):,} more; see the summary")
    for message in shown:
        yield f"::{command} title={_property(title)}::{_data(message)}"


def _data(text: str) -> str:
    return visible(text).replace("%", "%25").replace("\n", "%0A")


def _property(text: str) -> str:
    return _data(text).replace(":", "%3A").replace(",", "%2C")
