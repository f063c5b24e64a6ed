"""Every published word is explained, as it is published."""

import pytest

from contactlab.errors import SweepFileError
from contactlab.measure import LABELS, METRICS, THRESHOLDS
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.parameters import PARAMETERS
from contactlab.studies.explain.definitions import define_word


def test_every_word_has_its_own_definition() -> None:
    for each in LABELS.values():
        assert each.meaning in define_word(each.name)
        assert all(limit.source in define_word(each.name) for limit in each.thresholds)
    for each in METRICS.values():
        if each.name not in LABELS:
            assert each.definition in define_word(each.name)
    for each in THRESHOLDS.values():
        if each.name not in LABELS:
            assert each.source in define_word(each.name)
    assert all(each.description in define_word(name) for name, each in PARAMETERS.items())
    assert all(define_word(name).startswith(name) for name in EFFECTS)


def test_every_label_says_what_to_change() -> None:
    assert all(f"change: {label.advice}" in define_word(label.name) for label in LABELS.values())
    assert all(label.advice for label in LABELS.values())


def test_the_places_of_labels_are_counted_from_the_worst() -> None:
    """From 1 to how many there are, in the order in which they are published."""
    count = len(LABELS)
    for place, name in enumerate(LABELS, 1):
        assert define_word(name).startswith(f"{name}: a label, {place} of {count} from the worst")


def test_an_unknown_word_is_met_with_the_closest() -> None:
    with pytest.raises(SweepFileError, match="did you mean 'chatter'"):
        define_word("chater")
