"""Every word that code declares for output has a definition; a planted one without is found."""

import json
import shutil
from pathlib import Path

import pytest
from tests.explain.printed_words import (
    PACKAGE,
    definition_text,
    head_words,
    page_words,
    schema_words,
    table_words,
)

from contactlab.errors import SweepFileError
from contactlab.measure import METRICS
from contactlab.studies.check.check_entries import CHECKS
from contactlab.studies.explain.definitions import is_defined, words_of
from contactlab.studies.explain.glossary import read_glossary
from contactlab.writers.signs import ORDER, outcome_mark

TEMPLATES = sorted((PACKAGE / "page" / "templates").glob("*.html"))


def undefined(words: dict[str, str]) -> dict[str, str]:
    """Return the words without a definition, with the places that print them."""
    return {word: place for word, place in words.items() if not is_defined(word)}


def test_every_word_of_a_report_is_defined() -> None:
    assert undefined(schema_words()) == {}


def test_every_head_of_a_table_is_defined() -> None:
    assert undefined(head_words()) == {}
    headings = {metric.heading: metric.name for metric in METRICS.values() if metric.heading}
    assert undefined(headings) == {}


@pytest.mark.parametrize("template", TEMPLATES, ids=[path.stem for path in TEMPLATES])
def test_every_head_of_the_page_is_defined(template: Path) -> None:
    words = page_words(template.read_text(encoding="utf-8"))
    assert undefined(dict.fromkeys(words, template.name)) == {}


def test_every_outcome_and_limit_is_defined() -> None:
    names = {*(outcome_mark(outcome).word for outcome in ORDER), *CHECKS}
    names |= {limit.name for check in CHECKS.values() for limit in check.limits}
    assert undefined(dict.fromkeys(names, "check")) == {}


def test_a_planted_word_is_found(tmp_path: Path) -> None:
    """In a field of a schema, in the heads of a table in code, and in those of a page."""
    (tmp_path / "tune.schema.json").write_text(json.dumps({"enum": ["gribbled", "ok"]}))
    assert undefined(schema_words(tmp_path)) == {"gribbled": "tune."}
    code = tmp_path / "code"
    shutil.copytree(PACKAGE / "commands", code)
    module = code / "planted.py"
    module.write_text(
        "def show():\n    header = ('run', 'wibbled')\n    print_table(header, [])\n"
        "def rows():\n    return ('womble', 'run'), []\nprint_table(*rows())\n"
        "Section('x', header=('snorkled',))\nListing(['plugh'], [])\n"
    )
    assert undefined(head_words(code)).keys() == {"wibbled", "womble", "snorkled", "plugh"}
    page = "<tr><th>run</th><th scope='col'>blorted{% if x %}{% endif %}</th><th>{{ x }}</th></tr>"
    assert undefined(dict.fromkeys(page_words(page), "page")) == {"blorted": "page"}
    words = table_words(("label", "when"), [("frobbed", "noon"), ("stable", "-")])
    assert [word for word in words if not is_defined(word)] == ["when", "frobbed"][1:]


def test_every_term_and_synonym_answers() -> None:
    for term in read_glossary():
        for word in (term.word, *term.synonyms):
            assert f"{term.word}: {term.context}\n{term.definition}" in definition_text(word)


def test_terms_are_sentences_and_stand_once_in_a_context() -> None:
    terms = read_glossary()
    assert len({(term.context, term.word) for term in terms}) == len(terms)
    for term in terms:
        assert term.definition.endswith("."), term.word
        assert term.word not in term.synonyms
        assert len(term.definition.split(". ")[0].split()) <= 32, term.word


def test_a_word_is_found_however_it_is_written() -> None:
    assert definition_text("Numerical Error") == definition_text("numerical error")
    assert definition_text("duration [s]") == definition_text("duration")
    assert words_of(["numerical", "error"]) == ["numerical error"]
    assert words_of(["chatter", "creep"]) == ["chatter", "creep"]
    assert "an axis of the scene ball_drop" in definition_text("drop_height")


def test_an_unknown_word_suggests_the_nearest() -> None:
    for typed, nearest in (("inacurate", "inaccurate"), ("numerical eror", "numerical error")):
        with pytest.raises(SweepFileError, match=f"did you mean '{nearest}'"):
            definition_text(typed)
