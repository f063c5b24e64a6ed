"""Planted faults of an engine are grouped in their stage, shrunk, judged and drafted."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.advisories.advisory_files import read_advisory
from contactlab.parts import register_parts
from contactlab.rendering.text import render_text
from contactlab.schema.advisory import Advisory
from contactlab.schema.differences_report import DifferenceGroup, DifferencesReport
from contactlab.studies.advisories import release_windows
from contactlab.studies.advisories.corpus import generate_models
from contactlab.studies.advisories.differences_document import describe_differences
from contactlab.studies.advisories.finding import (
    FindRequest,
    compare_engines,
    find_differences,
)
from contactlab.studies.advisories.release_windows import (
    State,
    Windows,
    evaluate_windows,
    record_states,
)
from contactlab.tasks.session import Session

register_parts()
# Two arms at their limits, boxes that rest on a floor and on each other, and a far ball.
MODEL = """
<mujoco>
  <option solver="CG" iterations="100" tolerance="1e-12"/>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 .1"/>
    <body name="arm" pos="0 1 1">
      <joint name="shoulder" axis="0 1 0" limited="true" range="-20 20"/>
      <geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/>
      <body name="hand" pos=".3 0 0">
        <joint name="elbow" axis="0 1 0" limited="true" range="-20 20"/>
        <geom type="capsule" fromto="0 0 0 .2 0 0" size=".03"/>
      </body>
    </body>
    <body name="low" pos="0 0 .099"><freejoint/><geom name="low" type="box" size=".1 .1 .1"/></body>
    <body name="high" pos=".02 0 .298"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
    <body name="ball" pos="2 0 .5"><freejoint/><geom name="ball" size=".1"/></body>
  </worldbody>
  <keyframe>
    <key name="bent" qpos=".4 .4 0 0 .099 1 0 0 0 .02 0 .298 1 0 0 0 2 0 .5 1 0 0 0"/>
  </keyframe>
</mujoco>
"""
Fault = Callable[[Windows], Windows]


def in_contacts(change: Callable[[np.ndarray], np.ndarray]) -> Fault:
    """Return a fault that changes the contacts of each state."""

    def plant(windows: Windows) -> Windows:
        exact = {**windows.exact, "contacts": [*map(change, windows.exact["contacts"])]}
        return windows._replace(exact=exact)

    return plant


def in_model(monkeypatch: pytest.MonkeyPatch, **fields: Callable[[Any], Any]) -> None:
    """Let models of the second engine have other numbers in some fields."""
    compile_text = release_windows.compile_text

    def compile_faulty(text: str) -> mujoco.MjModel:
        model = compile_text(text)
        for name, change in fields.items():
            owner = model.opt if hasattr(model.opt, name) else model
            setattr(owner, name, change(getattr(owner, name)))
        return model

    monkeypatch.setattr(release_windows, "compile_text", compile_faulty)


def turned(rows: np.ndarray) -> np.ndarray:
    return np.hstack([rows[:, :19], np.roll(rows[:, 19:], 1, axis=1)])


PLANTED: dict[str, tuple[str, str, str]] = {
    "normal": ("collision", "normal", ""),
    "dropped": ("collision", "count", ""),
    "inertia": ("compiler", "body_inertia", ""),
    "stopped": ("constraints", "qfrc_constraint", "2.0.0"),
    "limit": ("constraints", "qfrc_constraint", ""),
}


def compared(
    tmp_path: Path, second: Callable[[str, Sequence[State]], Windows]
) -> DifferencesReport:
    file = tmp_path / "model.xml"
    file.write_text(MODEL, encoding="utf-8")
    request = FindRequest([str(file)], ("1.0.0", "2.0.0"), seconds=60)
    session = Session(tmp_path / "found")
    return compare_engines(request, session, (evaluate_windows, second), record_states)


def only_group(report: DifferencesReport) -> DifferenceGroup:
    (group,) = report.groups
    return group


@pytest.mark.long
@pytest.mark.parametrize("name", PLANTED)
def test_a_planted_fault_is_grouped_and_shrunk(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    faults: dict[str, Fault] = {
        "normal": in_contacts(turned),
        "dropped": in_contacts(lambda rows: rows[1:]),
    }
    changed: dict[str, dict[str, Callable[[Any], Any]]] = {
        "inertia": {"body_inertia": lambda values: 1.2 * values},
        "stopped": {"iterations": lambda _: 1},
        "limit": {"jnt_limited": lambda values: 0 * values},
    }

    def second(text: str, states: Sequence[State]) -> Windows:
        with monkeypatch.context() as patched:
            in_model(patched, **changed.get(name, {}))
            return faults.get(name, lambda windows: windows)(evaluate_windows(text, states))

    stage, quantity, faulty = PLANTED[name]
    group = only_group(compared(tmp_path, second))
    assert (group.stage, group.quantity.partition(" of ")[0]) == (stage, quantity)
    assert group.bodies <= 3
    assert group.faulty == faulty
    draft = read_advisory(Path(group.draft))
    assert isinstance(draft, Advisory)
    assert draft.witness.right == pytest.approx(group.first)
    assert draft.witness.wrong == pytest.approx(group.second)


def test_equal_engines_do_not_differ(tmp_path: Path) -> None:
    report = compared(tmp_path, evaluate_windows)
    assert (report.compared, report.states, report.groups) == (1, 12, ())
    assert report.headline == "0 faults and 0 changes from 1.0.0 to 2.0.0, in 1 model"
    assert "12 states" in render_text(describe_differences(report), 80)


def test_every_generated_model_compiles_and_has_its_own_name() -> None:
    models = list(generate_models())
    assert len({name for name, _ in models}) == len(models)
    for _, text in models:
        assert release_windows.compile_text(text).nv


@pytest.mark.night
def test_the_run_finds_listed_faults_without_their_advisories(tmp_path: Path) -> None:
    request = FindRequest(["generated"], ("3.13.0", "4.0.0"))
    report = find_differences(request, Session(tmp_path / "found"))
    found = {
        group.quantity: {advisory[-2:] for advisory in group.listed} for group in report.groups
    }
    for quantity, number in {
        "body_mass of the saved model": "11",
        "body_pos of the saved model": "20",
        "geom_friction of the saved model": "13",
        "saved model is refused": "19",
        "dof_M0": "12",
        "count of flex - plane": "05",
        "qacc": "01",
        "accelerometer": "02",
        "force": "04",
        "qpos": "09",
        "qvel": "15",
    }.items():
        assert number in found[quantity], quantity
    for group in report.groups:
        read_advisory(Path(group.draft))
