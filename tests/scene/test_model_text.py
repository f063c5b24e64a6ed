"""Elements stand where an XML parser finds them, and changes touch nothing else."""

import xml.etree.ElementTree as ET
from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab import resources
from contactlab.scene.model_text import (
    apply_replacements,
    attribute_text,
    elements_of,
    remove_element,
    with_attributes,
)

MODELS = [
    each for name in resources.scene_names() for each in resources.scene_folder(name).glob("*.xml")
]
TRAPS = b"""<?xml version="1.0"?><!DOCTYPE a [<!ENTITY e "<b/>">]>
<a><!-- <b x="1"/> --> <b x='>"'
  y = "/>" /><![CDATA[<b/>]]><c z="a='3'"><b/></c></a><!-- <d/> -->
"""


@pytest.mark.parametrize("path", [None, *MODELS], ids=lambda path: path and path.parent.name)
def test_elements_are_those_of_a_parser(path: Path | None) -> None:
    data = path.read_bytes() if path else TRAPS
    parsed = list(ET.fromstring(data).iter())  # noqa: S314 - shipped, or from here
    for element, place in zip(parsed, elements_of(data), strict=True):
        whole = ET.fromstring(data[place.start : place.end])  # noqa: S314 - as above
        assert [each.tag for each in whole.iter()] == [each.tag for each in element.iter()]
        assert whole.attrib == element.attrib
        assert data[place.start : place.inner].endswith(b">")


NAMES = st.sampled_from(["x", "y", "z", "condim"])
VALUES = st.text("0123456789.- ", min_size=1, max_size=9)


@given(st.dictionaries(NAMES, VALUES))
def test_attributes_are_set_and_others_stay(values: dict[str, str]) -> None:
    for number, place in enumerate(elements_of(TRAPS)):
        data = apply_replacements(TRAPS, [with_attributes(TRAPS, place, values)])
        before, after = (list(ET.fromstring(each).iter()) for each in (TRAPS, data))  # noqa: S314 - made here
        assert [each.tag for each in after] == [each.tag for each in before]
        for index, (old, new) in enumerate(zip(before, after, strict=True)):
            assert new.attrib == (old.attrib | values if index == number else old.attrib)


def test_what_is_removed_takes_its_lines_only_if_it_is_alone() -> None:
    data = b"<a>\n  <b/>\n  <c/> <d>\n  </d>\n</a>"
    _, b, c, d = elements_of(data)
    assert apply_replacements(data, [remove_element(data, b)]) == b"<a>\n  <c/> <d>\n  </d>\n</a>"
    assert (
        apply_replacements(data, [remove_element(data, c)]) == b"<a>\n  <b/>\n   <d>\n  </d>\n</a>"
    )
    assert (
        apply_replacements(data, [remove_element(data, each) for each in (b, c, d)])
        == b"<a>\n   \n</a>"
    )


@pytest.mark.parametrize("text", ["a & b", "<\t>", "\n\r", 'say "x"', "it's", "'\"&", ""])
def test_attributes_are_written_as_the_standard_library_writes_them(text: str) -> None:
    """Its function is not called, because it loads network protocols."""
    assert attribute_text({"name": text}) == f" name={quoteattr(text)}"
