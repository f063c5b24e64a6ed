"""The catalogue of modifications: each entry is well formed, and each consumer reads it."""

import copy
import operator
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import mujoco
import numpy as np
import pytest
from tests.budget_motions import walker

from contactlab.budget import error_budget, judge
from contactlab.budget.fixes import candidates_against
from contactlab.measure import LABELS
from contactlab.mjcf import OPTIONS
from contactlab.modifications.catalogue import (
    CATALOGUE,
    find_row,
    find_softness_rows,
    is_numerical_label,
    list_candidates,
    list_features,
    list_reductions,
    list_rows,
)
from contactlab.modifications.model_changes import raise_time_constants
from contactlab.modifications.modification import (
    ANY_LABEL,
    NO_EDITS,
    Candidate,
    Lever,
    Modification,
    Row,
)
from contactlab.scene.effects.effect_table import EFFECTS
from contactlab.scene.model_edits import FLAG_NAMES, is_writable
from contactlab.scene.mujoco_versions import missing_flags
from contactlab.studies.search.search_space import propose_parameters

ELEMENTS = {
    "keyframe",
    "exclude",
    "freejoint",
    "geom type",
    "ctrl",
    "flag",
    "maxhullvert",
    "sensor",
    "pair",
}
"""Elements and attributes of a file that entries edit, besides settings and fields."""
UNWRITTEN = {"flex_solref", "geom_contype", "geom_conaffinity"}
"""Fields that entries edit and no setting can name."""
OF_THE_MODEL = {"filterparent", "constraint", "invdiscrete"}
"""Effects of sweeps that define a model itself."""
MODEL = mujoco.MjModel.from_xml_string("<mujoco/>")


def test_raised_time_constants_move_as_the_safeguard_does() -> None:
    """A contact of 3 ms at a step of 4 ms is one of 8 ms, written or raised by the engine."""
    guarded = mujoco.MjModel.from_xml_string(
        """<mujoco><option timestep=".004"/><default><geom solref=".003 1"/></default><worldbody>
        <geom type="plane" size="1 1 .1"/><body pos="0 0 .11"><freejoint/><geom size=".1"/></body>
        </worldbody></mujoco>"""
    )
    written = copy.copy(guarded)
    written.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_REFSAFE
    raise_time_constants(written, guarded)
    ends = []
    for model in (guarded, written):
        data = mujoco.MjData(model)
        mujoco.mj_step(model, data, nstep=100)
        ends.append(data.qpos.tolist())
    assert ends[0] == ends[1]


def halve_noise(model: mujoco.MjModel, _own: mujoco.MjModel | None = None) -> None:
    model.opt.timestep /= 2


PLANTED = Modification(
    "planted",
    "Halves the time step.",
    ("timestep",),
    "computation",
    rows=(Row("planted row", "half the step, planted", "numerics", (halve_noise,), base="step"),),
    fixes=(Candidate("planted fix", "inaccurate", rate=2, labels=("divergence",)),),
    levers=(Lever("noslip_tolerance", (0.1,), "above"),),
)


@pytest.fixture
def plant_entry() -> Iterator[Modification]:
    CATALOGUE.add(PLANTED)
    yield PLANTED
    del CATALOGUE[PLANTED.name]


@pytest.mark.parametrize("entry", CATALOGUE.values(), ids=lambda entry: entry.name)
def test_each_entry_names_things_that_exist(entry: Modification) -> None:
    rows = {row.name for row in list_rows()}
    known = {*OPTIONS, *FLAG_NAMES, *ELEMENTS}
    for name in entry.edits:
        is_field = hasattr(MODEL, name) and (is_writable(name) or name in UNWRITTEN)
        remedy = f"{name} is no setting; a field that no setting can name belongs to UNWRITTEN"
        assert name in known or is_field or hasattr(MODEL.opt, name), remedy
    assert {*entry.answered_rows} <= rows
    assert {*entry.labels} <= {*LABELS, ANY_LABEL}
    assert entry.summary.endswith(".")
    for fix in entry.fixes:
        assert not fix.exercised or fix.exercised in rows
        # A fix with a name for `--apply` makes another model.
        assert fix.changes_model == (entry.kind == "model")


def changed_fields(model: mujoco.MjModel, made: mujoco.MjModel) -> set[str]:
    names = (name for name in dir(model) if isinstance(getattr(model, name, None), np.ndarray))
    return {name for name in names if not np.array_equal(getattr(model, name), getattr(made, name))}


@pytest.mark.parametrize("entry", CATALOGUE.values(), ids=lambda entry: entry.name)
def test_fields_that_a_fix_changes_are_written(entry: Modification) -> None:
    """Only options and flags are written from `change`; a fix of fields says how."""
    model = walker().model
    for fix in entry.fixes:
        made = copy.copy(model)
        fix.change(made)
        written = fix.edits != NO_EDITS or fix.values
        assert written or not changed_fields(model, made), fix.name


def test_a_changed_field_is_seen() -> None:
    model = walker().model
    made = copy.copy(model)
    made.dof_damping[0] += 1
    assert changed_fields(model, made) == {"dof_damping"}


def test_names_are_unique_in_each_use() -> None:
    for names in (
        [row.name for row in list_rows()],
        [fix.name for stage in ("usual", "further") for fix in list_candidates(stage)],
        [lever.setting for entry in CATALOGUE.values() for lever in entry.levers],
        [feature.name for entry in CATALOGUE.values() for feature in entry.features],
    ):
        assert sorted(names) == sorted({*names})


def test_rows_come_by_kind() -> None:
    kinds = [row.kind for row in list_rows()]
    assert [*dict.fromkeys(kinds)] == ["numerics", "model", "effect", "unknown"]
    assert sum(one != two for one, two in pairwise(kinds)) == 3


def test_labels_of_softness_have_rows_and_are_not_numerical() -> None:
    """Shorter steps do not remove labels of soft parts."""
    for label in LABELS:
        if find_softness_rows(label):
            assert not is_numerical_label(label)
    assert find_softness_rows("constraint_violated") == ("limit softness", "equality softness")
    assert not is_numerical_label("contact_at_distance")
    assert is_numerical_label("energy_injection")
    assert is_numerical_label("a label of a plug-in")


def test_a_planted_entry_comes_out_in_each_consumer(
    plant_entry: Modification,
) -> None:
    assert plant_entry.fixes
    motion = walker(0.01)
    budget = error_budget([motion], rows=["planted row"])
    assert [row.name for row in budget.phases[0].rows] == ["planted row"]
    verdict = replace(judge(budget, 1e-9), word="inaccurate")
    assert "planted fix" in {one.name for one in candidates_against([motion], verdict)}
    levers = {one.name: one.values for one in propose_parameters(motion.model)}
    assert levers["noslip_tolerance"] == [{"noslip_tolerance": 0.1}]


BOXES = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1" condim="6"/>
    <body><freejoint/><geom name="box" type="box" size=".1 .1 .1"/></body></worldbody></mujoco>"""


def test_levers_propose_only_values_on_their_side() -> None:
    model = mujoco.MjModel.from_xml_string(BOXES)
    model.opt.iterations, model.opt.tolerance = 20, 1e-7
    found = {one.name: one for one in propose_parameters(model)}
    late = [values["iterations"] for values in found["iterations"].step_sensitive]
    assert (found["iterations"].values, late) == ([], [10, 5, 3])
    assert [values["tolerance"] for values in found["tolerance"].values] == [1e-6, 1e-4]
    assert found["condim"].values == [{"geom_condim[floor]": 4}, {"geom_condim[floor]": 3}]
    assert "impratio" not in found


def test_each_effect_of_sweeps_has_one_entry() -> None:
    names = [feature.name for feature in list_features()]
    assert len(names) == len({*names})
    assert {*EFFECTS} - {*names} == OF_THE_MODEL & {*EFFECTS}


def test_a_feature_of_fields_clears_those_that_act() -> None:
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody>
      <body><joint name="heavy" armature=".5"/><geom size=".1"/></body>
      <body><joint name="light"/><geom size=".1"/></body></worldbody></mujoco>""")
    (armature,) = (one for one in list_features() if one.name == "armature")
    assert armature.settings_without(model) == {"dof_armature[heavy]": 0.0}
    model.dof_armature[:] = 0
    assert armature.settings_without(model) == {}


def test_reductions_without_a_proof_are_applied_by_name() -> None:
    named = {one.name: one.distance for one in list_reductions() if not one.is_exact}
    assert named == {"far-pairs": 0.05, "hulls": 0.001, "sensors": None}


def test_levers_and_removals_name_things_that_exist() -> None:
    rows = {row.name for row in list_rows()}
    for entry in CATALOGUE.values():
        for lever in entry.levers:
            assert {*lever.rows} <= rows
            assert lever.setting in {*OPTIONS, *FLAG_NAMES, *missing_flags(), "condim"}
        for removal in entry.removals:
            assert not removal.fields or any(hasattr(MODEL, field) for field in removal.fields)


_CHANGED = """<mujoco><option impratio="3" noslip_iterations="2"/><worldbody><body>
<joint type="slide" range="0 1" damping="2" stiffness="5" frictionloss=".1"/>
<geom size=".1" margin=".01" friction=".8 .01 .001" solref=".03 .9"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("row", "field", "factors"),
    [
        ("impratio", "opt.impratio", (10,)),
        ("noslip", "opt.noslip_iterations", (5,)),
        ("contact softness", "geom_solref", ((0.5, 1),)),
        ("limit softness", "jnt_solref", ((0.5, 1),)),
        ("friction loss softness", "dof_solref", ((0.5, 1),)),
        ("margin", "geom_margin", (0,)),
        ("damping", "dof_damping", (0,)),
        ("springs", "jnt_stiffness", (0,)),
        ("friction loss", "dof_frictionloss", (0,)),
        ("friction 10 %", "geom_friction", ((1.1, 1, 1), (0.9, 1, 1))),
        ("mass 5 %", "body_mass", (1.05, 0.95)),
        ("mass 5 %", "body_inertia", (1.05, 0.95)),
    ],
)
def test_a_row_changes_a_field_by_the_factor_of_its_summary(
    row: str, field: str, factors: tuple[float | tuple[float, ...], ...]
) -> None:
    """A summary such as `impratio x 10` is the change of the model, for any value in its file."""
    model = mujoco.MjModel.from_xml_string(_CHANGED)
    read = operator.attrgetter(field)
    before = np.array(read(model))
    for change, factor in zip(find_row(row).changes, factors, strict=True):
        changed = copy.copy(model)
        change(changed, model)
        assert read(changed) == pytest.approx(before * np.array(factor))
        assert before.any(), "otherwise every factor would do"
