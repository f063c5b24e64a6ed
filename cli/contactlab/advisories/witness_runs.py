"""Replays the witness of an advisory under the MuJoCo of this process."""

import warnings
from typing import NamedTuple

import mujoco

from contactlab.advisories.field_expressions import FieldExpression, ModelFacts
from contactlab.advisories.met_advisories import find_obstacle
from contactlab.errors import AdvisoryError, SceneError
from contactlab.expression import ExpressionError
from contactlab.scene.model_xml import list_elements, parse_text
from contactlab.scene.mujoco_versions import silence_mujoco
from contactlab.schema.advisory import Advisory, Witness


class WitnessRun(NamedTuple):
    """The measured value of a witness, and why it does not meet the advisory; empty if it does."""

    measured: float
    obstacle: str


def replay_witness(advisory: Advisory) -> WitnessRun:
    """Compile the witness, step it, compute it forward, and measure it.

    Raises:
        AdvisoryError: this MuJoCo refuses the model, or lacks a field or object.
    """
    silence_mujoco()
    witness = advisory.witness
    try:
        model = compile_witness(witness)
        data = mujoco.MjData(model)
        if witness.keyframe:
            mujoco.mj_resetDataKeyframe(model, data, model.key(witness.keyframe).id)
        mujoco.mj_step(model, data, nstep=witness.steps)
        mujoco.mj_forward(model, data)
        elements = list_elements(parse_text(witness.model, "witness.model"))
        facts = ModelFacts(model, data, lambda: elements)
        result = FieldExpression(witness.measure).evaluate_facts(facts)
        obstacle = find_obstacle("applies", advisory.applies, facts)
        if not obstacle and advisory.occurs:
            obstacle = find_obstacle("occurs", advisory.occurs, facts)
        return WitnessRun(result, obstacle)
    except (ValueError, KeyError, mujoco.FatalError, ExpressionError, SceneError) as error:
        raise AdvisoryError(f"{advisory.id}: {str(error).partition(chr(10))[0]}") from error


def compile_witness(witness: Witness) -> mujoco.MjModel:
    """Return the compiled model of a witness, without warnings about its text."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if not witness.saved:
            return mujoco.MjModel.from_xml_string(witness.model)
        spec = mujoco.MjSpec.from_string(witness.model)
        spec.compile()
        return mujoco.MjModel.from_xml_string(spec.to_xml())


def fault_share(witness: Witness, result: float) -> float:
    """Return how far a value is on the way from right to wrong; infinite if it is not a number."""
    share = (result - witness.right) / (witness.wrong - witness.right)
    return share if share == share else float("inf")  # noqa: PLR0124 - not a number
