"""Requirements of runs, found among the bodies, sites and contact pairs of a model."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import cast

import mujoco
import numpy as np

from contactlab.contact.expected_motion import ExpectedMotion
from contactlab.contact.required_words import CONTACT_WORDS, ContactWord, MotionWord
from contactlab.contact.rotations import multiply, rotate_back
from contactlab.contact.trace_arrays import Floats
from contactlab.contact.trace_setup import ExpectedContact
from contactlab.errors import SceneError, did_you_mean
from contactlab.scene.compiled_scene import CompiledScene
from contactlab.scene.contact_pairs import reaches
from contactlab.scene.model_names import matching, name_of
from contactlab.scene.run_spec import RunSpec
from contactlab.scene.timed_inputs import computed, read_formula
from contactlab.schema.requirement import Requirement, read_requirement
from contactlab.schema.scene_manifest import SceneManifest

Asked = tuple[str, Sequence[bool]]
"""What a sweep requires, and of which of n runs."""

_ROUNDING = 1e-9
_NEVER = (np.nan, np.nan)
"""The window of a run that nothing is said of."""
_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])
_BODY, _SITE = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_SITE
_Frame = tuple[mujoco.mjtObj, int]


def required_of(
    base: CompiledScene,
    manifest: SceneManifest | None,
    runs: Sequence[RunSpec],
    models: Sequence[mujoco.MjModel],
    asked: Sequence[Asked],
) -> tuple[ExpectedContact | ExpectedMotion, ...]:
    """Return what n runs of one structure must do, by their scene's words and their sweep's."""
    every = [True] * len(models)
    own = [(text, every) for text in (manifest.must if manifest else ())]
    found = list[ExpectedContact | ExpectedMotion]()
    for text, where in (*own, *asked):
        said = read_requirement(text)
        windows = np.array(
            [
                _window(said, run.initial) if on else _NEVER
                for run, on in zip(runs, where, strict=True)
            ]
        )
        if said.word in CONTACT_WORDS:
            found.append(_contact(base, said, windows))
        else:
            found.append(_motion(base, models, said, windows))
    return tuple(found)


def check_requirements(base: CompiledScene, manifest: SceneManifest) -> None:
    """Check what a manifest requires; a SceneError says what is wrong."""
    for place, text in enumerate(manifest.must):
        if mistake := mistake_in_requirement(text, base, manifest, manifest.duration):
            raise SceneError(f"must.{place}: {mistake}")


def mistake_in_requirement(
    text: str, base: CompiledScene, manifest: SceneManifest | None, duration: float
) -> str | None:
    """Return what is wrong with a requirement for runs of a duration [s]; None if it fits.

    Times are those of the initial values that a manifest has by default.
    """
    said, initial = read_requirement(text), manifest.initial if manifest else {}
    if said.word in CONTACT_WORDS:
        mistake = _unknown_pair(said, base)
    else:
        mistake = _unknown_name(said, base.model) or _unmonitored(said, base)
    if mistake is None:
        try:
            start, stop = _window(said, {name: value.default for name, value in initial.items()})
        except SceneError as error:
            mistake = str(error)
        else:
            mistake = _outside(start, stop, duration)
    return mistake and f"'{text}': {mistake}"


def _outside(start: float, stop: float, duration: float) -> str | None:
    if not 0 <= start < duration:
        return f"{start:g} s is not within the run, which takes {duration:g} s"
    if not start < stop:
        return f"{stop:g} s is not after {start:g} s"
    if np.isfinite(stop) and stop > duration * (1 + _ROUNDING):
        return f"{stop:g} s is after the end of the run, which takes {duration:g} s"
    return None


def _window(said: Requirement, initial: Mapping[str, float]) -> tuple[float, float]:
    """Return from when to when something has to hold in a run [s]."""
    start, stop = (
        default if term is None else computed(read_formula(term, f"`{key}` goes", initial), initial)
        for term, key, default in ((said.start, "from", 0.0), (said.stop, "until", np.inf))
    )
    return start, stop


def _unknown_pair(said: Requirement, base: CompiledScene) -> str | None:
    """Return that no monitored pair is named so, if none is."""
    (name,) = said.names
    if _pairs_named(base, name):
        return None
    bodies, sides = _pair_names(base)
    known = [*bodies, *sides]
    hint = _hint(name, known) if known else "; name pairs in the `pairs` of a scene"
    return f"'{name}' names no monitored pair{hint}"


def _pairs_named(base: CompiledScene, name: str) -> tuple[int, ...]:
    """Return the indices of the monitored pairs of a body or a pair, or of a pattern of such."""
    for names in _pair_names(base):
        if found := matching(names, name):
            return tuple(sorted({index for known in found for index in names[known]}))
    return ()


def _pair_names(base: CompiledScene) -> tuple[dict[str, list[int]], dict[str, list[int]]]:
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


def _contact(base: CompiledScene, said: Requirement, windows: Floats) -> ExpectedContact:
    """Return what pairs should do in windows (n, 2) of n runs [s]."""
    (name,) = said.names
    return ExpectedContact(
        name="every monitored pair" if name == "*" else name,
        pairs=_pairs_named(base, name),
        window=windows,
        word=cast("ContactWord", said.word),
        end=said.end,
        timed=(said.start, said.stop) != (None, None),
        force=(said.least, said.limit) if said.unit == "N" else (-np.inf, np.inf),
        depth=said.limit if said.word == "shallow" else np.inf,
    )


def _unknown_name(said: Requirement, model: mujoco.MjModel) -> str | None:
    """Return which name the model lacks."""
    bodies, sites = _names(model, _BODY), _names(model, _SITE)
    holder = () if said.holder is None else (said.holder,)
    for name, kind in (
        *((name, "body") for name in (said.names[0], *holder)),
        *((name, "body or site") for name in said.names[1:]),
    ):
        known = bodies if kind == "body" else [*bodies, *sites]
        if name not in known:
            return f"no {kind} '{name}'{_hint(name, known)}"
    return None


def _unmonitored(said: Requirement, base: CompiledScene) -> str | None:
    """Return of what no contact is monitored, although one decides."""
    body, holder = said.names[0], said.holder
    if holder is not None and not _pairs_between(base, body, holder):
        return (
            f"no contact of '{body}' and '{holder}' is monitored; name one in the `pairs` of a "
            "scene, or another body that holds it"
        )
    return None


def _hint(name: str, known: Sequence[str]) -> str:
    few = f"; write one of {', '.join(known)}" if 0 < len(known) <= 12 else ""
    return did_you_mean(name, known) or few


def _motion(
    base: CompiledScene,
    models: Sequence[mujoco.MjModel],
    said: Requirement,
    windows: Floats,
) -> ExpectedMotion:
    """Return what a body should do in windows (n, 2) of n runs [s]."""
    model, body = base.model, _id(base.model, _BODY, said.names[0])
    frame: _Frame = (_BODY, 0)
    if said.holder is not None:
        frame = (_BODY, _id(model, _BODY, said.holder))
    elif said.word == "passes":
        kind = _BODY if said.names[1] in _names(model, _BODY) else _SITE
        frame = (kind, _id(model, kind, said.names[1]))
    ups = np.array([_up(each) for each in models])
    axes = [_in_default_pose(each, body, up) for each, up in zip(models, ups, strict=True)]
    return ExpectedMotion(
        name=said.text,
        word=cast("MotionWord", said.word),
        window=windows,
        limit=said.limit,
        angular=said.unit == "rad",
        placing=tuple(partial(_poses, each, body, frame) for each in models),
        up=ups,
        axis=np.array(axes),
        reach=float(reaches(model)[body]),
        pairs=_pairs_between(base, said.names[0], said.holder) if said.holder else (),
    )


def _names(model: mujoco.MjModel, kind: mujoco.mjtObj) -> list[str]:
    word, count = ("body", model.nbody) if kind == _BODY else ("site", model.nsite)
    return [name_of(model, word, index) for index in range(count)]


def _id(model: mujoco.MjModel, kind: mujoco.mjtObj, name: str) -> int:
    return _names(model, kind).index(name)


def _pairs_between(base: CompiledScene, one: str, other: str) -> tuple[int, ...]:
    """Return the monitored pairs of two bodies, with all that hangs on each."""
    trees = [_tree(base.model, _id(base.model, _BODY, name)) for name in (one, other)]
    # What hangs on the first does not hold it, even where that hangs on the second.
    trees[1] -= trees[0]
    found: list[int] = []
    for index, pair in enumerate(base.pairs):
        owners = [int(base.model.geom_bodyid[side[0]]) for side in pair.geoms]
        if any(a in trees[0] and b in trees[1] for a, b in (owners, owners[::-1])):
            found.append(index)
    return tuple(found)


def _tree(model: mujoco.MjModel, root: int) -> set[int]:
    tree = {root}
    for body in range(root + 1, model.nbody):
        if int(model.body_parentid[body]) in tree:
            tree.add(body)
    return tree


def _up(model: mujoco.MjModel) -> Floats:
    size = float(np.linalg.norm(model.opt.gravity))
    return -np.asarray(model.opt.gravity) / size if size > 0 else np.array([0.0, 0.0, 1.0])


def _in_default_pose(model: mujoco.MjModel, body: int, direction: Floats) -> Floats:
    """Return (3,) a direction of the world in the frame of a body at qpos0."""
    _, turn = _poses(model, body, (_BODY, 0), np.asarray(model.qpos0)[None])
    return rotate_back(turn[0], direction)


def _poses(model: mujoco.MjModel, body: int, frame: _Frame, qpos: Floats) -> tuple[Floats, Floats]:
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
        place[row] = rotate_back(own, data.xpos[body] - origin)
        turn[row] = multiply(own * _CONJUGATE, data.xquat[body])
    return place, turn
