"""The lines for a model set in MuJoCo what the runs were set to."""

from typing import Any

import mujoco
import numpy as np
import pytest

from contactlab.mjcf import CONTACT, FLAGS, OPTIONS
from contactlab.pareto.configuration_export import MjcfLines, mjcf_lines
from contactlab.scene.model_edits import FLAGS as SWITCHES
from contactlab.schema.evidence import EvidenceRecord

SETTINGS: dict[str, Any] = {
    "timestep": 1e-3 / 3,
    "integrator": "RK4",
    "cone": "elliptic",
    "solver": "CG",
    "jacobian": "dense",
    "impratio": 10.0,
    "gravity": (0.1, 0.2, -3.0),
    "wind": (1.0, 0.0, 0.0),
    "iterations": 7,
    "tolerance": 1e-11,
    "ls_iterations": 9,
    "ls_tolerance": 0.02,
    "noslip_iterations": 3,
    "noslip_tolerance": 1e-5,
    "ccd_iterations": 11,
    "ccd_tolerance": 1e-7,
    "density": 1.2,
    "viscosity": 2e-5,
    "solref": (-160000.0, -144.7),
    "solimp": (0.8, 0.97, 0.002, 0.4, 3.0),
    "friction": (0.7, 0.7, 0.006, 2e-4, 2e-4),
    "condim": 6,
    "margin": 1e-3,
    "gap": 5e-4,
    "mass": 2.0,
}
STATES = {"warmstart": False, "refsafe": True, "multiccd": True}


def lines(*knobs: str) -> MjcfLines:
    axes = {name: STATES.get(name, SETTINGS.get(name, 0.5)) for name in knobs}
    record = EvidenceRecord.model_construct(settings=SETTINGS, axes=axes)
    return mjcf_lines(knobs, record)


def compiled(mjcf: tuple[str, ...]) -> mujoco.MjModel:
    body = '<worldbody><body><freejoint/><geom name="g" size="0.1"/></body></worldbody>'
    return mujoco.MjModel.from_xml_string(f"<mujoco>{''.join(mjcf)}{body}</mujoco>")


@pytest.mark.parametrize("name", sorted(OPTIONS))
def test_every_option_arrives_exactly(name: str) -> None:
    model = compiled(lines(name).mjcf)
    found = getattr(model.opt, name)
    words: dict[str, Any] = {
        "integrator": mujoco.mjtIntegrator.mjINT_RK4,
        "cone": mujoco.mjtCone.mjCONE_ELLIPTIC,
        "solver": mujoco.mjtSolver.mjSOL_CG,
        "jacobian": mujoco.mjtJacobian.mjJAC_DENSE,
    }
    assert np.array_equal(found, words.get(name, SETTINGS[name]))
    assert not np.array_equal(found, getattr(compiled(()).opt, name))


@pytest.mark.parametrize("name", sorted(CONTACT))
def test_every_default_of_a_geom_arrives_exactly(name: str) -> None:
    found = getattr(compiled(lines(name).mjcf).geom("g"), name)
    friction = tuple(SETTINGS["friction"][place] for place in (0, 2, 3))
    expected = friction if name == "friction" else SETTINGS[name]
    assert np.array_equal(np.ravel(found), np.ravel(expected))


@pytest.mark.parametrize("name", ["solref.timeconst", "solref.dampratio", "restitution", "solref"])
def test_a_part_of_solref_sets_the_whole(name: str) -> None:
    found = compiled(lines(name).mjcf).geom("g").solref
    assert tuple(found) == SETTINGS["solref"]


def test_switches_arrive() -> None:
    model = compiled(lines("warmstart", "multiccd", "timestep").mjcf)
    assert model.opt.disableflags == mujoco.mjtDisableBit.mjDSBL_WARMSTART
    default = compiled(()).opt
    assert model.opt.enableflags != default.enableflags or not hasattr(
        mujoco.mjtEnableBit, "mjENBL_MULTICCD"
    )
    assert model.opt.timestep == SETTINGS["timestep"]


def test_every_switch_of_the_engine_is_known() -> None:
    assert set(SWITCHES) <= FLAGS


def test_gravity_is_an_option_and_a_switch() -> None:
    """An axis of a sweep may mean either; an effect that is no switch is left to the reader."""

    def mjcf(gravity: object) -> MjcfLines:
        axes = {"impratio": 10.0, "gravity": gravity, "elliptic": True}
        record = EvidenceRecord.model_construct(settings=SETTINGS, axes=axes)
        return mjcf_lines(axes, record)

    assert mjcf("0.1 0.2 -3").mjcf == ('<option impratio="10" gravity="0.1 0.2 -3"/>',)
    off = ('<option impratio="10">', '  <flag gravity="disable"/>', "</option>")
    assert mjcf(False).mjcf == off
    assert mjcf(False).other == {"elliptic": True}


def test_what_mjcf_has_no_line_for_is_named() -> None:
    found = lines("timestep", "mass", "dof_damping[hinge]")
    assert found.mjcf == (f'<option timestep="{SETTINGS["timestep"]!r}"/>',)
    assert found.other == {"mass": 2.0, "dof_damping[hinge]": 0.5}


def test_all_lines_together_are_one_model() -> None:
    model = compiled(lines(*OPTIONS, *CONTACT, *STATES).mjcf)
    assert model.opt.impratio == SETTINGS["impratio"]
    assert model.geom("g").condim == SETTINGS["condim"]
