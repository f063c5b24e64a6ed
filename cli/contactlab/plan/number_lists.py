"""Long lists of numbers in a YAML text, read without the YAML parser.

The parser takes 50 us for a value, and 50 s for a million. It gets one letter for such a list.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import count
from typing import cast

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer
from ruamel.yaml.error import YAMLError
from ruamel.yaml.nodes import Node, ScalarNode, SequenceNode

LEAST_ITEMS = 1000
"""Shorter lists are parsed in 0.05 s."""
MOST_WRITTEN = 200_000
"""Most values apart from long lists: the parser takes 10 s for them."""
_LIST = re.compile(r"\[([-+.0-9eE, \r\n]*)\]")
_INTEGER = re.compile("[-+]?(0|[1-9][0-9]{0,17})")
_FLOAT = re.compile(r"[-+]?(([0-9]+\.[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?|[0-9]+[eE][-+]?[0-9]+)")
_ITEM = re.compile(r"[^, \r\n]+")
_LINE_BREAK = re.compile("\r\n|[\n\r]")
# Unicode leaves these letters to private use; a text with one of them is parsed as a whole.
_LETTERS = range(0xE000, 0xF900)


@dataclass(frozen=True)
class NumberList:
    """The numbers of a list, and its text between the brackets."""

    numbers: Sequence[float]
    text: str

    def iterate_places(self) -> Iterator[tuple[int, int, int]]:
        """Yield line, column and length of each number.

        Lines count from that of the first number. Columns of the first line do so, too.
        """
        first = _ITEM.search(self.text)
        assert first is not None
        for line, text in enumerate(_LINE_BREAK.split(self.text[first.start() :])):
            for item in _ITEM.finditer(text):
                yield line, item.start(), len(item[0])


@dataclass(frozen=True)
class Composition:
    """A composed text.

    Attributes:
        yaml: its loader, which constructs values of its nodes.
        root: None without values.
        lists: long lists of numbers by the `id` of their nodes. The inner nodes of such a list are
            one and the same node, with the start of the first number.
    """

    yaml: YAML
    root: Node | None
    lists: dict[int, NumberList]


def compose_yaml(text: str) -> Composition:
    """Return the nodes of a text.

    Raises:
        YAMLError: the text is not YAML, or has too many values.
    """
    shorter, lists = _replace_lists(text)
    if lists:
        composition = _compose_text(shorter, lists)
        # Brackets in a comment or within quotes are not a list.
        if len(composition.lists) == len(lists):
            return composition
    return _compose_text(text, {})


def _compose_text(text: str, lists: dict[str, NumberList]) -> Composition:
    yaml = YAML(typ="safe", pure=True)
    yaml.Composer = partial(_ListComposer, lists)
    yaml.composer.warn_double_anchors = False
    root = cast("Node | None", yaml.compose(text))
    return Composition(yaml, root, cast("_ListComposer", yaml.composer).found)


def _replace_lists(text: str) -> tuple[str, dict[str, NumberList]]:
    # A letter stands for each long list, with spaces up to its length.
    lists: dict[str, NumberList] = {}
    pieces: list[str] = []
    end = 0
    for match in _LIST.finditer(text):
        numbers = _read_numbers(match[1])
        if len(numbers) < LEAST_ITEMS or len(lists) == len(_LETTERS):
            continue
        letter = chr(_LETTERS[len(lists)])
        if letter in text:
            return text, {}
        lists[letter] = NumberList(numbers, match[1])
        blank = re.sub("[^\r\n]", " ", match[1])
        place = len(match[1]) - len(match[1].lstrip(" \r\n"))
        pieces += text[end : match.start(1)], blank[:place], letter, blank[place + 1 :]
        end = match.end(1)
    return "".join([*pieces, text[end:]]), lists


def _read_numbers(text: str) -> list[float]:
    # Empty if an item is not a plain number.
    if text.count(",") < LEAST_ITEMS - 1:
        return []
    numbers: list[float] = []
    for item in text.split(","):
        word = item.strip(" \r\n")
        if _INTEGER.fullmatch(word):
            numbers.append(int(word))
        elif _FLOAT.fullmatch(word):
            numbers.append(float(word))
        else:
            return []
    return numbers


class _ListComposer(Composer):
    def __init__(self, lists: dict[str, NumberList], loader: YAML) -> None:
        super().__init__(loader=loader)
        self.lists = lists
        self.found: dict[int, NumberList] = {}
        self.nodes = count(1)

    def compose_node(self, parent: Node | None, index: object) -> Node:
        if next(self.nodes) > MOST_WRITTEN:
            raise YAMLError(
                f"more than {MOST_WRITTEN:,} values outside of lists of numbers; "
                "use include: {file: runs.csv}"
            )
        return cast("Node", super().compose_node(parent, index))

    def compose_sequence_node(self, anchor: object) -> SequenceNode:
        node = cast("SequenceNode", super().compose_sequence_node(anchor))
        inner = cast("list[Node]", node.value)
        if len(inner) == 1 and isinstance(inner[0], ScalarNode) and inner[0].value in self.lists:
            self.found[id(node)] = numbers = self.lists[inner[0].value]
            node.value = inner * len(numbers.numbers)
        return node
