"""The rule of advisories: known faults of the installed engine that a model meets."""

import xml.etree.ElementTree as ET
from collections.abc import Iterator

from contactlab.advisories.met_advisories import describe_met_advisory, find_met_advisories
from contactlab.mjcf import OPTIONS
from contactlab.scene.model_edits import FLAG_NAMES
from contactlab.scene.model_text import mjcf_text
from contactlab.studies.lint.linted_model import Edit, Fault, LintedModel
from contactlab.studies.lint.rules import rule


@rule("advisory", "note")
def find_known_faults(linted: LintedModel) -> Iterator[Fault]:
    """The model meets a known fault of the installed engine.

    The message has the release that fixes it and a workaround. `contactlab MODEL` shows whether it
    matters in a motion. Fix: the workaround, or another release.
    """
    for each in find_met_advisories(linted.model, elements=lambda: linted.elements):
        settings = each.workarounds[0].settings if each.workarounds else {}
        edits: tuple[Edit, ...] = ()
        # A workaround with other settings has no edits.
        if settings.keys() <= {*OPTIONS, *FLAG_NAMES}:
            options = {name: mjcf_text(settings[name]) for name in settings if name in OPTIONS}
            edits = linted.set_in("option", **options) if options else ()
            flags = {
                name: "enable" if value else "disable"
                for name, value in settings.items()
                if name in FLAG_NAMES
            }
            if flags:
                element = ET.Element("option")
                ET.SubElement(element, "flag", flags)
                edits += linted.add(element)
        yield Fault(describe_met_advisory(each), linted.place_of("option"), edits)
