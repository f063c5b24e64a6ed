"""Every published word is explained, as it is published."""

import pytest
from tests.explain.printed_words import definition_text

from contactlab.commands.explain import explain
from contactlab.errors import SweepFileError
from contactlab.measure import LABELS, METRICS, THRESHOLDS
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.parameters import PARAMETERS
from contactlab.studies.explain.definitions import (
    define_word,
    is_defined,
    list_words,
)
from contactlab.studies.explain.glossary import read_glossary


def test_every_word_has_its_own_definition() -> None:
    for each in LABELS.values():
        assert each.meaning in definition_text(each.name)
        assert all(limit.source in definition_text(each.name) for limit in each.thresholds)
    for each in METRICS.values():
        if each.name not in LABELS:
            assert each.definition in definition_text(each.name)
    for each in THRESHOLDS.values():
        if each.name not in LABELS:
            assert each.source in definition_text(each.name)
    assert all(each.description in definition_text(name) for name, each in PARAMETERS.items())
    assert all(definition_text(name).startswith(name) for name in EFFECTS)


def test_every_label_says_what_to_change() -> None:
    assert all(
        f"change: {label.advice}" in definition_text(label.name) for label in LABELS.values()
    )
    assert all(label.advice for label in LABELS.values())


def test_the_places_of_labels_are_counted_from_the_worst() -> None:
    """From 1 to how many there are, in the order in which they are published."""
    count = len(LABELS)
    for place, name in enumerate(LABELS, 1):
        assert definition_text(name).startswith(
            f"{name}: a label; severity {LABELS[name].severity}, rank {place} of {count}, where"
        )


def test_an_unknown_word_is_met_with_the_closest() -> None:
    with pytest.raises(SweepFileError, match="did you mean 'chatter'"):
        definition_text("chater")


def test_without_a_word_every_defined_word_is_listed() -> None:
    listed = {name for kind in list_words() for text in kind.texts for name in text.split(", ")}
    for names in (LABELS, METRICS, EFFECTS, PARAMETERS):
        assert listed >= {*names}
    terms = [term.word for term in read_glossary()]
    assert all(is_defined(name) for name in listed - {*", ".join(terms).split(", ")})
    assert all(term in list_words()[-1].texts[0] for term in terms)
    assert explain().meanings == list_words()


def test_all_meanings_of_a_word_are_printed() -> None:
    """Also if a shipped scene adds an axis of the same name."""
    (axes,) = (kind.texts[0] for kind in list_words() if kind.word == "axes of shipped scenes")
    for name in axes.split(", "):
        titles = [meaning.title for meaning in define_word(name)]
        assert any("an axis of the scene" in title for title in titles)
    assert len(define_word("force")) == 2
    kinds = [meaning.title.partition(": ")[2] for meaning in define_word("drift")]
    assert [kind.split("; ")[0].split(", ")[0] for kind in kinds] == ["a label", "a metric"]
