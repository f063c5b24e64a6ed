"""The glossary: terms that output prints, with plain definitions, read from one file of data."""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import cast

_FILE = Path(__file__).with_name("glossary.toml")


@dataclass(frozen=True)
class Term:
    """One word in one context.

    Attributes:
        word: the word as output prints it.
        context: where it stands, such as "finding".
        definition: one to three plain sentences.
        synonyms: other words that users may type for it.
    """

    word: str
    context: str
    definition: str
    synonyms: tuple[str, ...] = ()


@cache
def read_glossary() -> tuple[Term, ...]:
    """Read every term, in the order of the file."""
    contexts = tomllib.loads(_FILE.read_text(encoding="utf-8"))
    return tuple(
        _read_term(word, context, entry)
        for context, entries in contexts.items()
        for word, entry in cast("Mapping[str, object]", entries).items()
    )


def _read_term(word: str, context: str, entry: object) -> Term:
    if isinstance(entry, str):
        return Term(word, context, entry)
    parts = cast("Mapping[str, object]", entry)
    synonyms = cast("Sequence[str]", parts["also"])
    return Term(word, context, str(parts["means"]), tuple(synonyms))
