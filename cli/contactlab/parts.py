"""Parts of contactlab that are loaded when used, registered as those of other packages are.

Every entry of the program registers them: the command, the functions of `contactlab`,
`contactlab.plugin`, `contactlab.testing`, `contactlab.gymnasium` and workers. Each function imports
and returns one part. The extra that a part needs is imported with it: a command without the extra
works, and one that uses the part names the extra.
"""

from functools import partial
from importlib import import_module
from types import ModuleType
from typing import Any, get_args

from contactlab.commands import CommandModule, load_command
from contactlab.registry import add_part, fill_registry

# ruff: noqa: PLC0415 - each part is imported when it is used


def _environment() -> Any:  # noqa: ANN401 - a class
    from contactlab.loop.environment_scene import Environment

    return Environment


def _ray() -> Any:  # noqa: ANN401 - a function
    from contactlab.run.ray.connection import ray_cluster

    return ray_cluster


def _slurm() -> Any:  # noqa: ANN401 - a function
    from contactlab.run.slurm.connection import slurm_arrays

    return slurm_arrays


def _object_storage() -> Any:  # noqa: ANN401 - a class
    from contactlab.store.objects.backend import ObjectBackend

    return ObjectBackend


def _film() -> Any:  # noqa: ANN401 - a function
    from contactlab.view.render import write_file

    return write_file


def _window() -> Any:  # noqa: ANN401 - a function
    from contactlab.view.render import open_viewer

    return open_viewer


def _geoms() -> Any:  # noqa: ANN401 - a function
    from contactlab.run.geom_naming import geom_replacers

    return geom_replacers


def _lock_schema() -> Any:  # noqa: ANN401 - a class
    from contactlab.studies.lock.lock_model import Lock

    return Lock


def _parity_schema() -> Any:  # noqa: ANN401 - a class
    from contactlab.studies.parity.parity_report import ParityReport

    return ParityReport


def _fork_server() -> ModuleType:
    from contactlab.run import preloaded

    return preloaded


_DESCRIPTIONS = {
    "BudgetReport": "contactlab.reporting.budget_document:describe_budget",
    "EffectsReport": "contactlab.studies.effects.effects_document:describe_effects",
    "EnginePanel": "contactlab.studies.engine_panel.panel_document:describe_panel",
    "FitReport": "contactlab.studies.fit.fit_document:describe_fit",
    "GradientsReport": "contactlab.studies.gradients.gradients_document:describe_gradients",
    "GripReport": "contactlab.studies.grip.grip_document:describe_grip",
    "PartsReport": "contactlab.studies.search.parts_document:describe_parts",
    "ShrinkReport": "contactlab.studies.shrink.shrink_document:describe_shrinking",
    "StabilityReport": "contactlab.reporting.stability_document:describe_stability",
    "TradeoffReport": "contactlab.pareto.tradeoff_document:describe_tradeoff",
    "TuneReport": "contactlab.studies.search.tune_document:describe_tuning",
    "DiffReport": "contactlab.studies.diff.compare_models:describe_diff",
    "LintReport": "contactlab.studies.lint.linting:describe_lint",
    "Examination": "contactlab.reporting.examination_document:describe_examination",
}
"""Functions that describe reports, by the class of the report."""


def _loaded(place: str) -> Any:  # noqa: ANN401 - a function
    module, _, name = place.partition(":")
    return getattr(import_module(module), name)


def add_parts() -> None:
    """Add contactlab's own parts to the registry of this process."""
    for name in get_args(CommandModule):
        add_part("command module", partial(load_command, name), name)
    add_part("environment", _environment, "mujoco")
    add_part("executor", _ray, "ray")
    add_part("executor", _slurm, "slurm")
    add_part("store", _object_storage, "az", "gs", "s3")
    add_part("viewer", _film, "gif", "mcap", "mp4", "png", "rrd")
    add_part("viewer", _window, "window")
    add_part("wording", _geoms, "geoms")
    add_part("schema", _lock_schema, "lock")
    add_part("schema", _parity_schema, "parity")
    for name, place in _DESCRIPTIONS.items():
        add_part("description", partial(_loaded, place), name)
    add_part("fork server", _fork_server, "preloaded")


def register_parts() -> None:
    """Have this process, and workers that it starts, find contactlab's own parts."""
    fill_registry(add_parts)
