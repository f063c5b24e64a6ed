"""How many values a YAML text comes to, counted before any of them is made."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from ruamel.yaml import YAML
from ruamel.yaml.nodes import MappingNode, Node, SequenceNode

from contactlab.plan import yaml_document
from contactlab.plan.yaml_document import extent_of, read_document

NAMES = ("a", "b", "c", "d")
# Lists that name one another, each only earlier ones, so that none is within itself.
LISTS = st.lists(st.lists(st.integers(0, 3), max_size=3), min_size=1, max_size=4)


def composed(text: str) -> Node:
    root = YAML(typ="safe", pure=True).compose(text)
    assert isinstance(root, Node)
    return root


def walked(node: Node) -> int:
    """Count by writing every alias out."""
    if isinstance(node, MappingNode):
        return 1 + sum(walked(value) for _, value in node.value)
    return 1 + sum(map(walked, node.value)) if isinstance(node, SequenceNode) else 1


def doubling(levels: int) -> str:
    """Return a text whose every level names the one before nine times."""
    lines = ["l0: &l0 [x]"]
    for level in range(1, levels):
        inner = ",".join([f"*l{level - 1}"] * 9)
        lines.append(f"l{level}: &l{level} [{inner}]")
    return "\n".join(lines)


@given(LISTS)
def test_it_is_what_a_walk_counts(lists: list[list[int]]) -> None:
    text = "\n".join(
        f"{name}: &{name} [7, "
        + ", ".join(f"*{NAMES[other]}" for other in others if other < place)
        + "]"
        for place, (name, others) in enumerate(zip(NAMES, lists, strict=False))
    )

    assert extent_of(composed(text)) == walked(composed(text))


def test_a_list_within_itself_has_no_end() -> None:
    assert extent_of(composed("a: &a [1, *a]")) == math.inf
    assert read_document("a: &a [1, *a]", "sweep").mistakes


def test_a_bomb_is_refused_before_it_is_made() -> None:
    """Forty levels come to more values than any machine holds, and to forty lists."""
    document = read_document(doubling(40), "sweep")

    assert "more than 1,000,000 values" in document.mistakes[0].message
    assert not document.values


def test_the_most_that_is_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    text = doubling(4)
    most = extent_of(composed(text))

    monkeypatch.setattr(yaml_document, "MOST_NODES", most)
    assert not read_document(text, "sweep").mistakes
    monkeypatch.setattr(yaml_document, "MOST_NODES", most - 1)
    assert read_document(text, "sweep").mistakes
