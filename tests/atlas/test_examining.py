"""A record says in one line why a model has no verdict."""

from bench.atlas.examining import said

from contactlab.errors import SceneError


def test_a_reason_is_said_whole_with_its_units() -> None:
    error = SceneError(
        "a.urdf: does not compile\n  hand: no\n  its moments are 0 kg m^2; write more"
    )
    assert said(error) == "a.urdf: does not compile: hand: no: its moments are 0 kg m^2; write more"


def test_lines_of_a_file_that_an_error_shows_are_left_out() -> None:
    shown = (
        "error[unknown-scene]: no scene\n --> sweep, column 1\n  |\n1 | scene: a\n  | ^ not here"
    )
    assert said(SceneError(shown)) == "no scene: not here"
