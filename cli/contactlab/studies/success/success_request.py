"""The request of a study of successes, and its sweep with the contacts of its object."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import mujoco

from contactlab.errors import SceneError, SweepFileError
from contactlab.plan.yaml_document import open_document
from contactlab.resources import find_sweep
from contactlab.scene.scene_source import MANIFEST, find_scene
from contactlab.scene.variants import AS_WRITTEN, Variant, load_variants
from contactlab.schema.drive import Drive
from contactlab.schema.sweep_schema import scene_reference
from contactlab.schema.vocabulary import VARIANT
from contactlab.studies.success.decisive_contacts import choose_pairs
from contactlab.tasks.session import Session

_REQUIREMENT = re.compile(r"\s*(success|physical)\s*>=\s*([\d.]+)\s*(%?)\s*")


@dataclass(frozen=True)
class SuccessRequest:
    """The episodes to play, and the definition of a physical success.

    Attributes:
        source: a store, a sweep file, FILE.py:FACTORY, or an id of Gymnasium.
        episodes: the number of cases, at most.
        drive: the policy; that of the sweep or its scene if None.
        objects: names of bodies of the object; found in the traces if empty.
        variants: names of the variants to play; all that apply if empty.
        depth_limit: largest depth that lasts, as a share of the thickness of the thinner body.
        requirements: such as `physical >= 80 %`; episodes end once all are decided.
        precision: half width of the intervals; episodes end once they have it.
        duration: of an episode [s]; the environment's if None.
    """

    source: str
    episodes: int | None = None
    drive: Drive | None = None
    objects: Sequence[str] = ()
    variants: Sequence[str] = ()
    depth_limit: float = 0.25
    requirements: Sequence[str] = ()
    precision: float | None = None
    duration: float | None = None

    @property
    def stops_early(self) -> bool:
        """Whether episodes may end before all are played."""
        return bool(self.requirements) or self.precision is not None


def read_requirement(text: str) -> tuple[str, float]:
    """Return the required quantity and its least share; a SweepFileError for another text."""
    match = _REQUIREMENT.fullmatch(text)
    if not match:
        raise SweepFileError(f"--require {text}: write `success >= 90 %` or `physical >= 80 %`")
    least = float(match[2]) / (100 if match[3] else 1)
    if not 0 < least < 1:
        raise SweepFileError(f"--require {text}: the share must be between 0 and 100 %")
    return match[1], least


def choose_variants(names: Sequence[str], model: mujoco.MjModel) -> list[Variant]:
    """Return the variants of names, or all, that change something in a model."""
    variants_by_name = load_variants()
    for name in names:
        SweepFileError.unless_known(name, variants_by_name, f"--variant {name}: no such variant")
    return [
        one
        for name, one in variants_by_name.items()
        if (not names or name in names) and one.applies(model)
    ]


def sweep_of_episodes(
    request: SuccessRequest, session: Session
) -> tuple[Mapping[str, Any], Path, list[Variant]]:
    """Return the sweep of all episodes as data, the folder of its paths, and its variants.

    A SceneError says that there is no environment, or that its code is not allowed or fails; a
    SweepFileError that the sweep file cannot be read.
    """
    sweep_text, folder = _read_source(request.source)
    reference = str(scene_reference(sweep_text["scene"]))
    source = find_scene(reference, folder, allow_code=session.allow_code)
    if source.environment is None:
        raise SceneError(
            f"{request.source}: its scene {source.name} has no successes; name an environment: "
            "write scene: {environment: FILE.py:FACTORY}"
        )
    model = mujoco.MjModel.from_binary_path(str(source.model))
    manifest = source.manifest
    assert manifest is not None
    if not manifest.pairs and manifest.drive == "none":
        pairs = choose_pairs(model, request.objects)
        own = source.environment
        name = own.name
        if own.files:
            name = f"{own.files[0].with_suffix('')}.py:{name.rpartition(':')[2]}"
        update = {"pairs": tuple(pairs), "environment": name, "model": "scene.xml"}
        text = manifest.model_copy(update=update).model_dump_json(
            indent=2, by_alias=True, exclude_defaults=True
        )
        replace(session, folder=session.folder / "scene").write({MANIFEST: text})
        reference = f"{(session.folder / 'scene').absolute()}/"
    variants = choose_variants(request.variants, model)
    axes = dict(cast("Mapping[str, object]", sweep_text.get("axes") or {}))
    if VARIANT in axes:
        raise SweepFileError(f"axes: {VARIANT}: leave it out; --variant chooses some of them")
    axes[VARIANT] = [AS_WRITTEN, *(variant.name for variant in variants)]
    episodes = request.episodes or sweep_text.get("seeds") or 100
    sweep = {**sweep_text, "scene": reference, "axes": axes, "seeds": episodes, "trace": "all"}
    if request.duration is not None:
        sweep["duration"] = request.duration
    return sweep, folder, variants


def _read_source(source: str) -> tuple[Mapping[str, Any], Path]:
    # The folder is that of relative paths.
    if not source.endswith((".yaml", ".yml")):
        return {"version": 1, "scene": {"environment": source}}, Path.cwd()
    path = find_sweep(source)
    data = open_document(path).data
    if not isinstance(data, dict) or "scene" not in data:
        raise SweepFileError(f"{path}: not a sweep file, since it has no scene")
    return cast("Mapping[str, Any]", data), path.parent
