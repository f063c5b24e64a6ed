"""A contact setting is what the monitored pairs then have, and nobody else."""

from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.mjcf import CONTACT
from contactlab.scene.parameters import PARAMETERS
from contactlab.scene.scene import Scene

VALUES: dict[str, Any] = {
    "solref": (-8000.0, -70.0),
    "solref.timeconst": 0.013,
    "solimp": (0.7, 0.95, 0.003, 0.4, 3.0),
    "friction": (0.55, 0.015, 0.0025),
    "friction.torsion": 0.07,
    "condim": 3,
    "margin": 0.004,
    "gap": 0.0015,
}
CONTACT_FIELDS = {
    "condim": "dim",
    "margin": "includemargin",
    "friction": "friction",
    "solref": "solref",
    "solimp": "solimp",
}
MONITORED = {frozenset(pair) for pair in (("floor", "low"), ("low", "top"), ("floor", "side"))}


def contacts(model: mujoco.MjModel, qpos: np.ndarray | None = None) -> dict[frozenset[str], Any]:
    """Return a contact of each touching pair of geoms."""
    data = mujoco.MjData(model)
    if qpos is not None:
        data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    # Contacts are views of the data, and end with it.
    return {
        frozenset(model.geom(geom).name for geom in each.geom): {
            name: np.array(getattr(each, name)) for name in CONTACT_FIELDS.values()
        }
        for each in data.contact
    }


def assert_has(contact: Any, name: str, asked: Any) -> None:
    # A contact does not keep its gap. Mixing equal values by unequal weights may round once.
    if name in CONTACT_FIELDS:
        found = np.ravel(contact[CONTACT_FIELDS[name]])
        assert found == pytest.approx(np.ravel(asked), rel=1e-15)


@pytest.mark.parametrize("name", VALUES)
def test_every_graded_pair_gets_the_value(name: str, unequal: Scene) -> None:
    run = unequal.resolve({name: VALUES[name]}, 0, None)
    prepared = unequal.base({}).prepare(run.list_edits())
    setting = PARAMETERS[name].sets
    touching = contacts(prepared.model)
    assert touching.keys() == MONITORED | {frozenset(("floor", "bystander"))}
    for pair in MONITORED:
        assert_has(touching[pair], setting, run.settings[setting])
    for record in prepared.pairs.values():
        asked = np.ravel(np.asarray(run.settings[setting]))
        assert np.ravel(getattr(record, setting)) == pytest.approx(asked, rel=1e-15)
    assert set(prepared.edited_geoms) == {"floor", "low", "top"}


@pytest.mark.parametrize("name", VALUES)
def test_nothing_else_is_touched(name: str, unequal: Scene, numbers_of: Any) -> None:
    base = unequal.base({})
    run = unequal.resolve({name: VALUES[name]}, 0, None)
    before, after = numbers_of(base.model), numbers_of(base.prepare(run.list_edits()).model)
    setting = PARAMETERS[name].sets
    own = {f"geom_{setting}", "pair_dim" if setting == "condim" else f"pair_{setting}"}
    changed = {key for key in before if not np.array_equal(before[key], after[key])}
    derived = {"body_margin"} if setting in ("margin", "gap") else set()
    assert changed <= own | derived | {"opt.disableflags"}
    assert changed & own
    outside = [base.model.geom(each).id for each in ("side", "bystander")]
    rows = before[f"geom_{setting}"][outside]
    assert np.array_equal(rows, after[f"geom_{setting}"][outside])


@pytest.mark.parametrize("name", VALUES)
@pytest.mark.parametrize("scene_name", ["ball_drop", "box_slide", "box_stack"])
def test_shipped_scenes(scene_name: str, name: str) -> None:
    scene = Scene.open(scene_name)
    run = scene.resolve({name: VALUES[name]}, 0, None)
    base = scene.base(run.structure)
    model = base.prepare(run.list_edits()).model
    # In each of them the lowest body rests with its centre at 0.05 m.
    sunk = scene.initial_states([run]).qpos[0]
    sunk[2] = 0.0495
    touching = contacts(model, sunk)
    setting = PARAMETERS[name].sets
    assert {frozenset(pair.sides) for pair in base.pairs} & touching.keys()
    for pair in base.pairs:
        if frozenset(pair.sides) in touching:
            assert_has(touching[frozenset(pair.sides)], setting, run.settings[setting])


@pytest.mark.long
def test_what_is_as_written_already_changes_nothing(unequal: Scene, differing: Any) -> None:
    for scene in (unequal, Scene.open("box_slide")):
        base = scene.base({})
        plain = base.prepare({}).model
        for name, value in base.settings.items():
            changed = differing(plain, base.prepare({name: value}).model)
            assert bool(changed) == (name in base.nonuniform), name
    assert unequal.base({}).nonuniform == set(CONTACT)
    assert Scene.open("box_slide").base({}).nonuniform == set()


def test_a_setting_and_a_field_of_the_same_geom(unequal: Scene) -> None:
    # The more particular one wins, whatever their names.
    values = {
        "solref": (0.01, 1.0),
        "geom_solref[top]": (0.02, 0.5),
        "mass": 5.0,
        "body_mass[low]": 7.0,
    }
    model = unequal.base({}).prepare(unequal.resolve(values, 0, None).list_edits()).model
    assert model.geom("top").solref.tolist() == [0.02, 0.5]
    assert model.geom("low").solref.tolist() == [0.01, 1.0]
    assert model.body("low").mass[0] == 7.0
