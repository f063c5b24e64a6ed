"""A changed model is opened without the warnings that its original has shown."""

import warnings
from pathlib import Path

import pytest

from contactlab.errors import ModelWarning
from contactlab.tasks.checked_model import open_changed_model, open_model
from contactlab.tasks.session import Session

MODEL = """
<mujoco><compiler settotalmass="1"/><worldbody><geom type="plane" size="1 1 .1"/>
<body pos="0 0 .0999"><freejoint/><geom type="sphere" size=".1"/></body></worldbody></mujoco>
"""


def test_only_the_original_warns(tmp_path: Path) -> None:
    session = Session(tmp_path / "results")
    original, changed = tmp_path / "original.xml", tmp_path / "changed.xml"
    original.write_text(MODEL)
    changed.write_text(MODEL)
    with pytest.warns(ModelWarning, match="settotalmass"):
        open_model(str(original), session)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        open_changed_model(str(changed), session)
