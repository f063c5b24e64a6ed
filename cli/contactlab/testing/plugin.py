"""Options and the fixture; their dependencies are imported when a test uses it."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from contactlab.parts import register_parts

if TYPE_CHECKING:
    from contactlab.testing.evidence import ContactEvidence

register_parts()


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options."""
    group = parser.getgroup("contactlab")
    group.addoption(
        "--contact-evidence",
        metavar="FOLDER",
        help="keep records of contact_evidence here, in a folder for each test",
    )
    group.addoption(
        "--contact-baseline",
        choices=("check", "update"),
        default="check",
        help="update: accept the records as the baselines that tests name",
    )


@pytest.fixture
def contact_evidence(request: pytest.FixtureRequest) -> "Iterator[ContactEvidence]":
    """Record a loop, and judge it."""
    from contactlab.testing.evidence import ContactEvidence  # noqa: PLC0415 - see the module

    kept_folder = request.config.getoption("--contact-evidence")
    name = re.sub(r"[^\w.-]+", "-", request.node.nodeid).strip("-")
    folder = (
        Path(kept_folder) / name
        if kept_folder
        else request.getfixturevalue("tmp_path") / "evidence"
    )
    update = request.config.getoption("--contact-baseline") == "update"
    evidence = ContactEvidence(folder, update=update)
    yield evidence
    evidence.close()
