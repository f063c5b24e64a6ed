"""Compares two releases over a corpus of models, and drafts an advisory for each cause."""

import math
import time
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
from ruamel.yaml import YAML
from ruamel.yaml.scalarstring import LiteralScalarString

from contactlab.advisories.advisory_files import list_advisories
from contactlab.advisories.field_expressions import ModelFacts
from contactlab.advisories.met_advisories import may_meet
from contactlab.errors import ContactlabError, EngineError
from contactlab.run.sweep_request import SceneLoader
from contactlab.scene.model_xml import list_elements
from contactlab.schema.differences_report import DifferenceGroup, DifferencesReport, RefusedModel
from contactlab.studies.advisories.corpus import CorpusModel, list_models
from contactlab.studies.advisories.differences import (
    COMPILER,
    INTEGRATION,
    SAVED,
    STAGES,
    Difference,
    DifferenceTrials,
    decide_fault,
    list_differences,
    measure_of,
    shrink_difference,
    start_at,
    state_at,
    state_of,
)
from contactlab.studies.advisories.release_process import ReleaseProcess
from contactlab.studies.advisories.release_windows import (
    WINDOW_STEPS,
    Evaluate,
    State,
    compile_text,
)
from contactlab.studies.shrink.failing_model import START, FailingModel, as_one_file
from contactlab.tasks.session import Session
from contactlab.temporary_folders import temporary_folder

_ORDER = tuple(dict.fromkeys(STAGES.values()))
_UNDECIDED = "CHANGE: find a closed form or an independent computation, or drop this draft"


@dataclass(frozen=True)
class FindRequest:
    """What to compare.

    Attributes:
        models: references, or `scenes` and `generated`.
        releases: the older and the newer one.
        seconds: wall time for shrinking one difference.
    """

    models: Sequence[str]
    releases: tuple[str, str]
    seconds: float = 10.0


class _FoundDifference(NamedTuple):
    model: FailingModel  # as one file, at the state
    text: str  # of the compared model
    state: State
    difference: Difference


Record = Callable[[str, State, Sequence[int]], list[State]]


def find_differences(request: FindRequest, session: Session) -> DifferencesReport:
    """Compare two releases over models, and write a draft for each cause into the session's folder.

    Raises:
        EngineError: a release cannot be installed.
        OutputError: the folder cannot be written.
    """
    first, second = request.releases
    with (
        ReleaseProcess(first, session.notify) as one,
        ReleaseProcess(second, session.notify) as other,
    ):
        return compare_engines(
            request, session, (one.evaluate_model, other.evaluate_model), one.record_model
        )


def compare_engines(
    request: FindRequest, session: Session, engines: tuple[Evaluate, Evaluate], record: Record
) -> DifferencesReport:
    """Compare two functions that compute windows; see `find_differences`."""
    differences_by_key = dict[tuple[str, str], dict[str, _FoundDifference]]()
    refused, compared, states = list[RefusedModel](), 0, 0
    with temporary_folder() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # they are about models, not about differences
        for member in list_models(request.models, Path(folder)):
            session.notify(member.name)
            try:
                began, differences = _compare_model(member, engines, record)
            except (ContactlabError, ValueError, KeyError, TypeError, mujoco.FatalError) as error:
                reason = str(error).splitlines()[0] if str(error) else type(error).__name__
                refused.append(RefusedModel(model=member.name, reason=reason))
                continue
            compared, states = compared + 1, states + began
            for each in differences:
                differences_by_key.setdefault(each.difference.key, {})[member.name] = each
    ordered = sorted(
        differences_by_key,
        key=lambda key: (_ORDER.index(key[0]), -len(differences_by_key[key]), key[1]),
    )
    files, groups = dict[str, str](), list[DifferenceGroup]()
    for number, key in enumerate(ordered, 1):
        session.notify(f"shrinking {key[0]}: {key[1]}")
        file = f"DRAFT-{number:04d}.yaml"
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            group, text = _report_group(request, key, differences_by_key[key], engines)
        files[file] = text
        groups.append(group.model_copy(update={"draft": str(session.folder / file)}))
    session.write(files)
    return DifferencesReport(
        releases=request.releases,
        compared=compared,
        states=states,
        refused=tuple(refused),
        groups=tuple(groups),
    )


def _compare_model(
    member: CorpusModel, engines: tuple[Evaluate, Evaluate], record: Record
) -> tuple[int, list[_FoundDifference]]:
    scene = SceneLoader(None).open(member.reference)
    run = scene.resolve({}, 0, None)
    start = scene.initial_states([run])
    flat = as_one_file(scene, run, start)
    # The text of a model of one file is compared: the flat one lacks defaults, frames and compiler
    # settings.
    text, compiled = member.text or flat, compile_text(member.text or flat)
    begin = state_at(compiled, start)
    # Steps before recorded states are closer in the first impacts; some faults are rare.
    steps = (1, 10, 20, 30, 40, 60, 80, 120, 160, 240, 320, 400)
    states = record(text, begin, steps)
    if not states:
        raise EngineError("no finite state")
    whole = mujoco.MjModel.from_xml_string(flat)
    differences = list[_FoundDifference]()
    for each in list_differences(compiled, *(evaluate(text, states) for evaluate in engines)):
        difference, state = each, states[each.place]
        if difference.stage == INTEGRATION:
            # A later step of the window may differ in an earlier stage.
            within = record(text, state, range(WINDOW_STEPS))
            windows = (evaluate(text, within) for evaluate in engines)
            closer = next(list_differences(compiled, *windows), None)
            if closer is not None and closer.stage != INTEGRATION:
                difference, state = closer, within[closer.place]
        model = FailingModel(flat, start_at(whole, state), WINDOW_STEPS * run.timestep)
        differences.append(_FoundDifference(model, text, state, difference))
    return len(states), differences


def _report_group(
    request: FindRequest,
    key: tuple[str, str],
    differences: dict[str, _FoundDifference],
    engines: tuple[Evaluate, Evaluate],
) -> tuple[DifferenceGroup, str]:
    trials = DifferenceTrials(*engines, key, time.monotonic() + request.seconds)
    smallest = min(differences.values(), key=lambda each: len(each.model.text))
    small = shrink_difference(smallest.model, trials)
    compared = trials.compare_releases(small)
    text, saved = small.text, SAVED in key[1]
    if compared is None:
        text = smallest.text
        windows = [evaluate(text, [smallest.state]) for evaluate in engines]
        difference = smallest.difference._replace(place=0)
    else:
        difference, *windows = compared
    faulty, reason = decide_fault(difference, request.releases, windows[0], windows[1])
    compiled = compile_text(text)
    state = smallest.state if text is smallest.text else state_of(small.start, compiled)
    group = DifferenceGroup(
        stage=key[0],
        quantity=key[1],
        models=tuple(differences),
        place=difference.quantity,
        first=difference.first,
        second=difference.second,
        faulty=faulty,
        reason=reason,
        bodies=int(compiled.nbody) - 1,
        draft="",
        listed=find_listed(text, compiled, request.releases, saved=saved),
    )
    # Differences of compilers are in the text itself, which is lost if it is written again.
    begins = key[0] != COMPILER
    witness = {"model": LiteralScalarString(write_start(text, state) if begins else text)}
    witness |= {"keyframe": START} if begins else {"saved": saved}
    return group, draft_advisory(group, request.releases, witness, compiled)


def find_listed(
    text: str, compiled: mujoco.MjModel, releases: tuple[str, str], *, saved: bool
) -> tuple[str, ...]:
    """Return the advisories that affect one of two releases only, and that a model meets.

    A difference of a saved model is that of advisories about saved models.
    """
    root = ET.fromstring(text)  # noqa: S314 - MuJoCo has read it
    facts = ModelFacts(compiled, list_elements=lambda: list_elements(root))
    return tuple(
        each.id
        for each in list_advisories()
        if each.witness.saved == saved
        and len({each.affects_release(release) for release in releases}) > 1
        and may_meet(each, facts)
    )


def write_start(text: str, state: State) -> str:
    """Return a model as MJCF with a state as its only keyframe."""
    spec = mujoco.MjSpec.from_string(text)
    for key in list(spec.keys):
        spec.delete(key)
    names = {"mocap_pos": "mpos", "mocap_quat": "mquat"}
    key = spec.add_key(name=START)
    for name, part in state.items():
        setattr(key, names.get(name, name), part.ravel())
    spec.compile()
    return spec.to_xml()


def draft_advisory(
    group: DifferenceGroup,
    releases: tuple[str, str],
    witness: Mapping[str, Any],
    compiled: mujoco.MjModel,
) -> str:
    """Return the YAML of an advisory about a difference, for an author to complete."""
    values = [math.nan if one is None else one for one in (group.first, group.second)]
    first_is_faulty, severity = group.faulty == releases[0], "wrong result"
    measure, (right, wrong) = measure_of(compiled, group.place), values
    if first_is_faulty:
        right, wrong = wrong, right
    if group.place == SAVED:  # it is refused
        severity, measure, right, wrong = "crash", "nbody", float(compiled.nbody), 0.0
    data: dict[str, Any] = {
        "id": "DRAFT-2026-0000",
        "title": f"{group.quantity} differs from {releases[0]} to {releases[1]}",
        "consequence": "Say how it shows in a simulation.",
        "affected": [
            {"introduced": "0", "fixed": releases[1]}
            if first_is_faulty
            else {"introduced": releases[1]}
        ],
        "severity": severity,
        "applies": "nv > 0",
        "witness": {
            **witness,
            "steps": WINDOW_STEPS if group.stage == INTEGRATION else 0,
            "measure": measure,
            "right": right,
            "wrong": wrong,
            "tolerance": abs(right - wrong) / 10,
            "reason": group.reason if group.faulty else f"{_UNDECIDED}; {group.reason}",
        },
        "advice": "Name a modification in `workarounds`, or say what to do.",
    }
    text = StringIO()
    YAML().dump(data, text)
    return text.getvalue()
