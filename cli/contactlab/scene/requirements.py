"""What `must` requires of runs, found among the bodies, sites and pairs of a model."""

from collections.abc import Sequence
from functools import partial

import mujoco
import numpy as np

from contactlab.contact.expected_motion import ExpectedMotion
from contactlab.contact.rotations import multiply, rotate_back
from contactlab.contact.trace_arrays import Floats
from contactlab.contact.trace_setup import ExpectedContact
from contactlab.errors import SceneError, did_you_mean
from contactlab.scene.compiled_scene import CompiledScene
from contactlab.scene.contact_pairs import reaches
from contactlab.scene.expected_contacts import NEVER, Asked, expected_contact, mistake_in
from contactlab.scene.model_names import name_of
from contactlab.schema.pair_expectation import PairExpectation
from contactlab.schema.requirement import Requirement, read_requirement
from contactlab.schema.scene_manifest import SceneManifest

_ROUNDING = 1e-9
_CONJUGATE = np.array([1.0, -1.0, -1.0, -1.0])
_BODY, _SITE = mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_SITE
_Frame = tuple[mujoco.mjtObj, int]


def required_of(
    base: CompiledScene,
    manifest: SceneManifest | None,
    models: Sequence[mujoco.MjModel],
    asked: Sequence[Asked],
) -> tuple[ExpectedContact | ExpectedMotion, ...]:
    """Return what n runs of one structure must do, by their scene's words and their sweep's."""
    every = [True] * len(models)
    own = [(text, every) for text in (manifest.must if manifest else ())]
    words = [(each, where) for each, where in asked if isinstance(each, str)]
    found = list[ExpectedContact | ExpectedMotion]()
    for text, where in (*own, *words):
        said = read_requirement(text)
        windows = [(said.start, said.stop) if on else NEVER for on in where]
        if said.word == "slides":
            found.append(expected_contact(base, _sliding(said), windows))
        else:
            found.append(_motion(base, models, said, windows))
    return tuple(found)


def check_requirements(base: CompiledScene, manifest: SceneManifest) -> None:
    """Check what a manifest requires; a SceneError says what is wrong."""
    for place, text in enumerate(manifest.must):
        if mistake := mistake_in_requirement(text, base, manifest.duration):
            raise SceneError(f"must.{place}: {mistake}")


def mistake_in_requirement(text: str, base: CompiledScene, duration: float) -> str | None:
    """Return what is wrong with a requirement for runs of a duration [s]; None if it fits."""
    said = read_requirement(text)
    mistake = _unknown_name(said, base.model) or _unmonitored(said, base)
    if mistake is None and said.start >= duration:
        mistake = f"{said.start:g} s is not within the run, which takes {duration:g} s"
    if mistake is None and np.isfinite(said.stop) and said.stop > duration * (1 + _ROUNDING):
        mistake = f"{said.stop:g} s is after the end of the run, which takes {duration:g} s"
    return mistake and f"'{text}': {mistake}"


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
    if said.word == "slides" and mistake_in(_sliding(said), base, {}, np.inf):
        return f"no contact of '{body}' is monitored; name one in the `pairs` of a scene"
    return None


def _hint(name: str, known: Sequence[str]) -> str:
    few = f"; write one of {', '.join(known)}" if 0 < len(known) <= 12 else ""
    return did_you_mean(name, known) or few


def _motion(
    base: CompiledScene,
    models: Sequence[mujoco.MjModel],
    said: Requirement,
    windows: Sequence[tuple[float, float]],
) -> ExpectedMotion:
    """Return what a body should do in windows of n runs [s]."""
    assert said.word != "slides"
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
        word=said.word,
        window=np.array(windows),
        limit=said.limit,
        angular=said.unit == "rad",
        placing=tuple(partial(_poses, each, body, frame) for each in models),
        up=ups,
        axis=np.array(axes),
        reach=float(reaches(model)[body]),
        pairs=_pairs_between(base, said.names[0], said.holder) if said.holder else (),
    )


def _sliding(said: Requirement) -> PairExpectation:
    """Return the same as an entry of `pairs` says it."""
    timed = {"from": said.start or None, "to": said.stop if np.isfinite(said.stop) else None}
    return PairExpectation.model_validate({"body": said.names[0], "mode": "slide", **timed})


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
