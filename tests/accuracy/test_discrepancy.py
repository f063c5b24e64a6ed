"""The norm on configurations is a norm, and equals the engine's own difference."""

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from contactlab.accuracy.reference import Discrepancy, invariant_drifts, trajectory_distances
from contactlab.contact.trace_arrays import Floats, Invariants
from contactlab.scene.run_setup import joints_of

MODEL = """
<mujoco>
  <worldbody>
    <body><freejoint/><geom size=".1 .2 .3" type="box"/></body>
    <body pos="2 0 0">
      <joint type="slide" axis="1 0 0"/><joint type="hinge" axis="0 1 0" pos=".3 0 0"/>
      <geom size=".1"/>
      <body pos="1 0 0">
        <joint type="ball"/><geom type="capsule" fromto="0 0 0 0 0 .4" size=".05"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
PART = st.floats(-1, 1, allow_subnormal=False)


def unit(size: int) -> st.SearchStrategy[Floats]:
    vectors = st.lists(PART, min_size=size, max_size=size).map(np.array)
    long = vectors.filter(lambda vector: np.linalg.norm(vector) > 0.1)
    return long.map(lambda vector: vector / np.linalg.norm(vector))


UNIT = unit(4)


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(MODEL)


@st.composite
def configurations(draw: st.DrawFn) -> Floats:
    """A free joint, a slide, a hinge and a ball, one row."""
    free, ball = draw(UNIT), draw(UNIT)
    places = [draw(PART) for _ in range(5)]
    return np.array([[*places[:3], *free, *places[3:], *ball]])


def by_the_engine(model: mujoco.MjModel, first: Floats, second: Floats) -> float:
    """The largest joint's length of the engine's own tangent vector, each part made metres."""
    tangent = np.zeros(model.nv)
    mujoco.mj_differentiatePos(model, tangent, 1.0, first[0], second[0])
    tangent *= model.dof_length
    ends = [*model.jnt_dofadr[1:].tolist(), model.nv]
    largest = 0.0
    for kind, begin, end in zip(model.jnt_type, model.jnt_dofadr.tolist(), ends, strict=True):
        free = kind == mujoco.mjtJoint.mjJNT_FREE
        parts = [slice(begin, begin + 3), slice(begin + 3, end)] if free else [slice(begin, end)]
        largest = max(largest, *(float(np.linalg.norm(tangent[part])) for part in parts))
    return largest


@given(first=configurations(), second=configurations())
def test_it_is_the_engines_difference(model: mujoco.MjModel, first: Floats, second: Floats) -> None:
    # Both lose digits of an angle near pi, where its tangent is steep: sqrt of rounding.
    found = trajectory_distances(joints_of(model), first, second)[0]
    assert found == pytest.approx(by_the_engine(model, first, second), rel=1e-6, abs=1e-7)


@given(first=configurations(), second=configurations(), third=configurations())
def test_it_is_a_metric(
    model: mujoco.MjModel, first: Floats, second: Floats, third: Floats
) -> None:
    joints = joints_of(model)

    def apart(one: Floats, other: Floats) -> float:
        return float(trajectory_distances(joints, one, other)[0])

    assert apart(first, first) <= 1e-15
    assert apart(first, second) == pytest.approx(apart(second, first), rel=1e-12, abs=1e-15)
    assert apart(first, third) <= apart(first, second) + apart(second, third) + 1e-7


def test_final_mean_and_peak() -> None:
    assert Discrepancy.of_distances(np.array([0.0, 3.0, 1.5])) == (1.5, 1.5, 3.0)


def conserved(energy: list[float], kinetic: list[float], lift: float) -> Invariants:
    return Invariants(np.array(energy), np.array(kinetic), None, None, 2.0, lift, 1e-3)


def test_energy_is_a_share_of_what_moves() -> None:
    reference = conserved([5.0, 5.0, 5.0], [0.0, 4.0, 2.0], 1.0)
    run = conserved([5.0, 5.5, 6.0], [9.0, 9.0, 9.0], 1.0)
    assert invariant_drifts(run, reference).tolist() == [0.0, 0.125, 0.25]


def test_energy_of_what_hardly_moves_is_a_share_of_a_lift() -> None:
    reference = conserved([5.0], [1e-9], 0.5)
    assert invariant_drifts(conserved([5.1], [0.0], 0.5), reference) == pytest.approx(
        [0.2], rel=1e-12
    )


def test_momenta_count_where_they_are_conserved() -> None:
    """K = 4 J and 2 kg give sqrt(2 m K) = 4 kg m/s; the spin's largest magnitude is 3."""
    reference = conserved([0.0], [4.0], 0.0)._replace(
        momentum=np.zeros((1, 3)), angular_momentum=np.array([[0.0, 3.0, 0.0]])
    )
    moved = reference._replace(momentum=np.array([[0.0, 0.0, 2.0]]))
    turned = reference._replace(angular_momentum=np.array([[0.0, 3.0, 0.6]]))
    assert invariant_drifts(moved, reference) == pytest.approx([0.5], rel=1e-12)
    assert invariant_drifts(turned, reference) == pytest.approx([0.2], rel=1e-12)
