"""Faults planted in a scene must show: each turns an expectation of a closed-form case red."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from contactlab import shipped
from contactlab.pipeline import Ask, Scenes, run_sweep
from contactlab.plan import Overrides, read_sweep

Planted = Callable[[str, str, str], int]


@pytest.fixture
def planted(tmp_path: Path) -> Planted:
    """Run a shipped sweep on a copy of its scene with one text replaced; count unmet runs."""

    def unmet(name: str, old: str, new: str) -> int:
        source = shipped.sweeps() / "stability" / f"{name}.yaml"
        text = source.read_text()
        scene = next(line for line in text.splitlines() if line.startswith("scene: "))[7:]
        shutil.copytree(shipped.models() / scene, tmp_path / scene)
        model = tmp_path / scene / "scene.xml"
        assert old in model.read_text()
        model.write_text(model.read_text().replace(old, new))
        copy = tmp_path / source.name
        copy.write_text(text.replace(f"scene: {scene}", f"scene: ./{scene}"))
        return _unmet(copy, tmp_path / "store")

    return unmet


def _unmet(sweep: Path, store: Path) -> int:
    scenes = Scenes(sweep.parent)
    read = read_sweep(sweep, scenes.vocabulary, Overrides(("trace=none",)))
    ask = Ask(
        plan=read.plan,
        scene=scenes.open(read.sweep.scene),
        name=sweep.stem,
        source=read.text,
        overrides=(),
        store=store,
        workers=0,
    )
    manifest = run_sweep(ask, lambda _total, _done: None, lambda _finished: None)
    return manifest.expectations.get("unmet", 0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("isotropy", 'friction="0.5 ', 'friction="0.525 '),
        ("incline", 'friction="0.5 ', 'friction="0.525 '),
        ("slide_directions", 'friction="0.5 ', 'friction="0.525 '),
        ("ladder", 'friction="0.3 ', 'friction="0.315 '),
        ("isotropy", "<option ", '<option gravity="0 0 -9.9081" '),
        ("free_fall", "<option ", '<option gravity="0 0 -9.9081" '),
        ("rest_penetration", "<option ", '<option gravity="0 0 -9.9081" '),
        ("isotropy", 'solref="0.02 1"', 'solref="0.022 1"'),
    ],
)
def test_planted_faults_show(planted: Planted, name: str, old: str, new: str) -> None:
    assert planted(name, old, new) > 0


@pytest.mark.slow
def test_nothing_planted_shows_nothing(planted: Planted) -> None:
    assert planted("isotropy", "<option ", "<option ") == 0
