"""The store's manifest, written last: a store without it is unfinished."""

from typing import Any, Literal

from pydantic import Field

from contactlab.schema.model import Model
from contactlab.schema.record import Engine, Provenance

STORE_VERSION = 2


class SweepIdentity(Model):
    """What a store's runs were asked to be; a resumed sweep must match it (`sweep.json`)."""

    store_version: Literal[2] = STORE_VERSION
    name: str
    source: str = Field(description="The sweep file's text.")
    overrides: tuple[str, ...] = Field(description="--set, --only and --limit, as given.")
    resolved: dict[str, Any] = Field(description="The sweep with defaults filled in.")
    scene: str
    scene_hash: str
    scene_model: str = Field(description="The model file, relative to scenes/<hash>.")
    engine: Engine
    metric_versions: dict[str, int]
    runs_asked: int
    lacking: dict[str, str] = Field(
        default_factory=dict,
        description="What this version of the engine cannot give, and so is null, with the reason.",
    )
    plan_hash: str = Field(description="Hash of every run id in plan order.")


class StoreManifest(Model):
    """What a finished store holds (`manifest.json`)."""

    store_version: Literal[2] = STORE_VERSION
    sweep: SweepIdentity
    provenance: Provenance
    runs: int
    labels: dict[str, int]
    statuses: dict[str, int]
    traces: int
    traces_left_out: bool = Field(
        default=False,
        description="Whether the traces that the records name were left out, as in a baseline.",
    )
    expectations: dict[str, int] = Field(description="Runs by outcome: met, unmet, none.")
    files: dict[str, str] = Field(description="SHA-256 of every file but traces and this one.")
    started: str
    finished: str
