"""Resolves requirements of runs against the bodies, sites and contact pairs of a model."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import cast

import mujoco
import numpy as np

from contactlab.contact.expected_motion import ExpectedMotion
from contactlab.contact.required_words import CONTACT_WORDS, MotionWord
from contactlab.contact.rotations import multiply_rotations, rotate_vectors_back
from contactlab.contact.trace_arrays import Floats
from contactlab.contact.trace_setup import ExpectedContact
from contactlab.errors import SceneError, did_you_mean
from contactlab.numerical_tolerance import SUM_ROUNDING
from contactlab.printable import first_names
from contactlab.scene.compiled_scene import CompiledScene
from contactlab.scene.contact_pairs import body_reaches
from contactlab.scene.model_names import match_names, name_of
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.timed_inputs import evaluate_formula, read_formula
from contactlab.schema.requirement import Requirement, read_requirement
from contactlab.schema.scene_manifest import SceneManifest

RunRequirement = tuple[str, Sequence[bool]]
"""A requirement of a sweep, and a mask of the n runs that it applies to."""

_NO_WINDOW = (np.nan, np.nan)
"""The window of a run without the requirement."""
_BODY, _SITE = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_SITE
_Frame = tuple[mujoco.mjtObj, int]


def expected_of_runs(
    base: CompiledScene,
    manifest: SceneManifest | None,
    runs: Sequence[RunSpec],
    models: Sequence[mujoco.MjModel],
    run_requirements: Sequence[RunRequirement],
) -> tuple[ExpectedContact | ExpectedMotion, ...]:
    """Return the requirements of n runs of one structure, from their scene and their sweep."""
    every = [True] * len(models)
    own = [(text, every) for text in (manifest.must if manifest else ())]
    expected = list[ExpectedContact | ExpectedMotion]()
    for text, where in (*own, *run_requirements):
        requirement = read_requirement(text)
        windows = np.array(
            [
                _requirement_window(requirement, run.initial) if on else _NO_WINDOW
                for run, on in zip(runs, where, strict=True)
            ]
        )
        if requirement.word in CONTACT_WORDS:
            (name,) = requirement.names
            expected.append(
                ExpectedContact(
                    name="every monitored pair" if name == "*" else name,
                    pairs=_find_pairs(base, name),
                    window=windows,
                    word=requirement.word,
                    end=requirement.end,
                    has_times=(requirement.start, requirement.stop) != (None, None),
                    force=(requirement.least, requirement.limit)
                    if requirement.unit == "N"
                    else (-np.inf, np.inf),
                    depth=requirement.limit if requirement.word == "shallow" else np.inf,
                )
            )
        else:
            expected.append(_expected_motion(base, models, requirement, windows))
    return tuple(expected)


def check_requirements(base: CompiledScene, manifest: SceneManifest) -> None:
    """Check the requirements of a manifest. Raises a SceneError with the mistake."""
    for place, text in enumerate(manifest.must):
        if mistake := mistake_in_requirement(text, base, manifest, manifest.duration or math.inf):
            raise SceneError(f"must.{place}: {mistake}")


def mistake_in_requirement(
    text: str, base: CompiledScene, manifest: SceneManifest | None, duration: float
) -> str | None:
    """Return the mistake in a requirement for runs of a duration [s]; None if there is none.

    Times are computed from the default initial values of a manifest.
    """
    requirement, initial = read_requirement(text), manifest.initial if manifest else {}
    if requirement.word in CONTACT_WORDS:
        mistake = None
        (name,) = requirement.names
        if not _find_pairs(base, name):
            bodies, sides = _index_pairs(base)
            known_names = [*bodies, *sides]
            hint = (
                _name_hint(name, known_names)
                if known_names
                else "; name pairs in the `pairs` of a scene"
            )
            mistake = f"'{name}' names no monitored pair{hint}"
    else:
        mistake = _unknown_name(requirement, base.model)
        body, holder = requirement.names[0], requirement.holder
        if mistake is None and holder is not None and not _pairs_between(base, body, holder):
            mistake = (
                f"no contact of '{body}' and '{holder}' is monitored; add one to the `pairs` of a "
                "scene, or name another body that holds it"
            )
    if mistake is None:
        try:
            start, stop = _requirement_window(
                requirement, {name: value.default for name, value in initial.items()}
            )
        except SceneError as error:
            mistake = str(error)
        else:
            if not 0 <= start < duration:
                mistake = f"{start:g} s is outside the run, which takes {duration:g} s"
            elif not start < stop:
                mistake = f"{stop:g} s is not after {start:g} s"
            elif np.isfinite(stop) and stop > duration * (1 + SUM_ROUNDING):
                mistake = f"{stop:g} s is after the end of the run, which takes {duration:g} s"
    return mistake and f"'{text}': {mistake}"


def _requirement_window(
    requirement: Requirement, initial: Mapping[str, float]
) -> tuple[float, float]:
    """Return the start and end of a requirement in a run [s]."""
    start, stop = (
        default
        if term is None
        else evaluate_formula(read_formula(term, f"`{key}` goes", initial), initial)
        for term, key, default in (
            (requirement.start, "from", 0.0),
            (requirement.stop, "until", np.inf),
        )
    )
    return start, stop


def _find_pairs(base: CompiledScene, name: str) -> tuple[int, ...]:
    """Return the indices of the monitored pairs of a body, a pair, or a pattern of either."""
    for names in _index_pairs(base):
        if pair_names := match_names(names, name):
            return tuple(sorted({index for pair_name in pair_names for index in names[pair_name]}))
    return ()


def _index_pairs(base: CompiledScene) -> tuple[dict[str, list[int]], dict[str, list[int]]]:
    """Return the indices of the monitored pairs of each body, and of each two sides."""
    bodies, both = dict[str, list[int]](), dict[str, list[int]]()
    for index, pair in enumerate(base.pairs):
        owners = [base.model.geom_bodyid[side[0]] for side in pair.geoms]
        own = [name_of(base.model, "body", owner) for owner in owners]
        for name in dict.fromkeys(own):
            bodies.setdefault(name, []).append(index)
        for name in dict.fromkeys(map("-".join, (pair.sides, own, pair.sides[::-1], own[::-1]))):
            both.setdefault(name, []).append(index)
    return bodies, both


def _unknown_name(requirement: Requirement, model: mujoco.MjModel) -> str | None:
    bodies, sites = _object_names(model, _BODY), _object_names(model, _SITE)
    holder = () if requirement.holder is None else (requirement.holder,)
    for name, kind in (
        *((name, "body") for name in (requirement.names[0], *holder)),
        *((name, "body or site") for name in requirement.names[1:]),
    ):
        known_names = bodies if kind == "body" else [*bodies, *sites]
        if name not in known_names:
            return f"no {kind} '{name}'{_name_hint(name, known_names)}"
    return None


def _name_hint(name: str, known_names: Sequence[str]) -> str:
    names = first_names(f"known here: {', '.join(known_names)}")
    return did_you_mean(name, known_names) or (f"; {names}" if known_names else "")


def _expected_motion(
    base: CompiledScene,
    models: Sequence[mujoco.MjModel],
    requirement: Requirement,
    windows: Floats,
) -> ExpectedMotion:
    """Return the motion that a body must have in windows (n, 2) of n runs [s]."""
    model, body = base.model, _object_id(base.model, _BODY, requirement.names[0])
    frame: _Frame = (_BODY, 0)
    if requirement.holder is not None:
        frame = (_BODY, _object_id(model, _BODY, requirement.holder))
    elif requirement.word == "passes":
        kind = _BODY if requirement.names[1] in _object_names(model, _BODY) else _SITE
        frame = (kind, _object_id(model, kind, requirement.names[1]))
    ups = np.array([_up_direction(each) for each in models])
    axes = [
        _direction_in_default_pose(each, body, up) for each, up in zip(models, ups, strict=True)
    ]
    return ExpectedMotion(
        name=requirement.text,
        word=cast("MotionWord", requirement.word),
        window=windows,
        limit=requirement.limit,
        angular=requirement.unit == "rad",
        placing=tuple(partial(_poses_in_frame, each, body, frame) for each in models),
        up=ups,
        axis=np.array(axes),
        reach=float(body_reaches(model)[body]),
        pairs=_pairs_between(base, requirement.names[0], requirement.holder)
        if requirement.holder
        else (),
    )


def _object_names(model: mujoco.MjModel, kind: mujoco.mjtObj) -> list[str]:
    word, count = ("body", model.nbody) if kind == _BODY else ("site", model.nsite)
    return [name_of(model, word, index) for index in range(count)]


def _object_id(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str) -> int:
    return _object_names(model, kind).index(name)


def _pairs_between(base: CompiledScene, one: str, other: str) -> tuple[int, ...]:
    """Return the monitored pairs of two bodies, including all descendants of each."""
    trees = [
        _body_subtree(base.model, _object_id(base.model, _BODY, name)) for name in (one, other)
    ]
    # Descendants of the first body do not hold it, even if they are also below the second.
    trees[1] -= trees[0]
    places: list[int] = []
    for index, pair in enumerate(base.pairs):
        owners = [int(base.model.geom_bodyid[side[0]]) for side in pair.geoms]
        if any(a in trees[0] and b in trees[1] for a, b in (owners, owners[::-1])):
            places.append(index)
    return tuple(places)


def _body_subtree(model: mujoco.MjModel, root: int) -> set[int]:
    tree = {root}
    for body in range(root + 1, model.nbody):
        if int(model.body_parentid[body]) in tree:
            tree.add(body)
    return tree


def _up_direction(model: mujoco.MjModel) -> Floats:
    size = float(np.linalg.norm(model.opt.gravity))
    return -np.asarray(model.opt.gravity) / size if size > 0 else np.array([0.0, 0.0, 1.0])


def _direction_in_default_pose(model: mujoco.MjModel, body: int, direction: Floats) -> Floats:
    """Return (3,) a direction of the world in the frame of a body at qpos0."""
    _, turn = _poses_in_frame(model, body, (_BODY, 0), np.asarray(model.qpos0)[None])
    return rotate_vectors_back(turn[0], direction)


def _poses_in_frame(
    model: mujoco.MjModel, body: int, frame: _Frame, qpos: Floats
) -> tuple[Floats, Floats]:
    """Return positions (M, 3) [m] and rotations (M, 4) of a body in a frame, for qpos (M, nq)."""
    data = mujoco.MjData(model)
    place, turn = np.empty((len(qpos), 3)), np.empty((len(qpos), 4))
    kind, index = frame
    origin, own = np.zeros(3), np.zeros(4)
    for row, configuration in enumerate(qpos):
        if not np.isfinite(configuration).all():
            place[row], turn[row] = np.nan, np.nan
            continue
        data.qpos = configuration
        mujoco.mj_kinematics(model, data)
        if kind == _SITE:
            origin = data.site_xpos[index]
            mujoco.mju_mat2Quat(own, data.site_xmat[index])
        else:
            origin, own = data.xpos[index], data.xquat[index]
        place[row] = rotate_vectors_back(own, data.xpos[body] - origin)
        turn[row] = multiply_rotations(own * np.array([1.0, -1.0, -1.0, -1.0]), data.xquat[body])
    return place, turn
