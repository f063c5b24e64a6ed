"""Which shipped scenes and robots of public wheels meet each advisory?

    ROBOT_WHEELS=... python -m bench.advisory_hits [WORD ...]

The predicates of all advisories are evaluated on each compiled model, as if the installed release
were affected. If an affected release is installed, the fault is looked for in plain MuJoCo: at 60
states of a run with random controls, accelerations of the sparse and of the dense Jacobian. With
words, only models with one of them in their name are counted.
"""

import os
import sys
import warnings
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
from bench.atlas.wheels import families

from contactlab.advisories.advisory_files import list_advisories
from contactlab.advisories.field_expressions import ModelFacts
from contactlab.advisories.met_advisories import may_meet
from contactlab.errors import ContactlabError, ModelWarning
from contactlab.foreign_code import printed_as_text
from contactlab.parts import register_parts
from contactlab.resources import scene_names
from contactlab.scene.compile_model import COMPILE_ERRORS
from contactlab.scene.compiled_scene import compile_scene
from contactlab.scene.scene_source import find_scene


def list_references(words: list[str]) -> Iterator[tuple[str, str, str]]:
    """Yield kind, name and reference of each shipped scene and of each robot."""
    for scene in scene_names():
        if not words or any(word in scene for word in words):
            yield "scene", scene, scene
    for family in families(Path(os.environ["ROBOT_WHEELS"])):
        for robot in family:
            if not words or any(word in robot.name for word in words):
                yield "robot", robot.name, str(robot.file)
                break


def compare_jacobians(model: mujoco.MjModel) -> float:
    """Return the largest relative difference of accelerations, sparse and dense."""
    random, data = np.random.default_rng(0), mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    low, high = model.actuator_ctrlrange.T
    worst = 0.0
    kinds = mujoco.mjtJacobian.mjJAC_SPARSE, mujoco.mjtJacobian.mjJAC_DENSE
    for _ in range(60):
        data.ctrl[:] = random.uniform(low, high)
        mujoco.mj_step(model, data, 5)
        found = list[np.ndarray]()
        for kind in kinds:
            model.opt.jacobian = int(kind)
            data.qacc_warmstart[:] = 0
            mujoco.mj_forward(model, data)
            found.append(data.qacc.copy())
        model.opt.jacobian = int(mujoco.mjtJacobian.mjJAC_DENSE)  # the run itself is right
        scale = float(np.abs(found[1]).max(initial=1e-9))
        if scale < 1e6:
            worst = max(worst, float(np.abs(found[0] - found[1]).max(initial=0.0)) / scale)
    return worst


def main() -> None:
    """Print a line for each advisory, and the difference of each model that meets one in force."""
    hits = defaultdict[str, list[str]](list)
    counts, refused = defaultdict[str, int](int), 0
    advisories = list_advisories()
    for kind, name, reference in list_references(sys.argv[1:]):
        try:
            with warnings.catch_warnings(), printed_as_text():
                warnings.simplefilter("ignore", ModelWarning)
                source = find_scene(reference)
                model = compile_scene(source, {}).model
        except (ContactlabError, *COMPILE_ERRORS):
            refused += kind == "robot"
            continue
        counts[kind] += 1
        facts = ModelFacts(model, list_elements=lambda source=source: source.elements)
        for advisory in advisories:
            if may_meet(advisory, facts):
                hits[advisory.id].append(f"{kind} {name}")
                if advisory.affects_release(mujoco.__version__):
                    worst = compare_jacobians(model)
                    print(f"{advisory.id}: {kind} {name}: accelerations differ by {worst:.2g}")
        sys.stdout.flush()
    print(f"{counts['scene']} scenes, {counts['robot']} robots; {refused} do not compile")
    for advisory in advisories:
        found = hits[advisory.id]
        scenes = sum(each.startswith("scene") for each in found)
        now = " (in force)" if advisory.affects_release(mujoco.__version__) else ""
        robots = [each.removeprefix("robot ") for each in found if each.startswith("robot")]
        print(f"{advisory.id}{now}: {scenes} scenes, {len(robots)} robots: {', '.join(robots[:4])}")


if __name__ == "__main__":
    register_parts()
    main()
