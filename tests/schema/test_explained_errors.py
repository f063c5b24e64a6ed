"""Mistakes in a file of a scene are named with their line and what to write instead."""

import pytest
from pydantic import ValidationError

from contactlab.schema.explained_errors import explain_file_errors
from contactlab.schema.scene_manifest import SceneManifest

FIRST = "version: 1\nmodel: ball.xml\n"


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("duration: abc", "line 3: duration: write a number, not 'abc'"),
        ("duration: 1\npair: []", "line 4: pair: unknown key; did you mean 'pairs'?"),
        ("duration: 1\nhold:\n  from: 0.5", "line 4: hold.to: it is missing"),
        ("thresholds: [1, 2]", "line 3: thresholds: write a mapping, {NAME: VALUE}, not [1, 2]"),
        ("thresholds: {drift: -1}", "line 3: thresholds.drift: must be greater than or equal to 0"),
        ("duration: -1", "line 3: duration: must be greater than 0"),
        ("pairs:\n  - {geoms: [a, b]}\n  - 7", "line 5: pairs.1: write a mapping"),
    ],
)
def test_each_mistake_has_its_line_and_remedy(text: str, line: str) -> None:
    from ruamel.yaml import YAML  # noqa: PLC0415 - as in the package

    document = FIRST + text
    with pytest.raises(ValidationError) as caught:
        SceneManifest.model_validate(YAML(typ="safe").load(document))
    lines = explain_file_errors(caught.value, SceneManifest, document)
    assert any(each.startswith(line) for each in lines), lines
