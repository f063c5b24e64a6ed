"""Parts of contactlab that are loaded when used, registered as those of other packages are.

Every entry of the program registers them: the command, the functions of `contactlab`,
`contactlab.plugin`, `contactlab.testing`, `contactlab.gymnasium` and workers. Each function imports
and returns one part. The extra that a part needs is imported with it: a command without the extra
works, and one that uses the part names the extra.
"""

from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, get_args

from contactlab.commands import CommandModule, load_command
from contactlab.registry import add_part, fill_registry

# ruff: noqa: PLC0415 - each part is imported when it is used


def _load_environment() -> Any:  # noqa: ANN401 - a class
    from contactlab.loop.environment_scene import Environment

    return Environment


def _load_ray() -> Any:  # noqa: ANN401 - a function
    from contactlab.run.ray.connection import ray_cluster

    return ray_cluster


def _load_slurm() -> Any:  # noqa: ANN401 - a function
    from contactlab.run.slurm.connection import slurm_arrays

    return slurm_arrays


def _load_object_storage() -> Any:  # noqa: ANN401 - a class
    from contactlab.store.objects.backend import ObjectBackend

    return ObjectBackend


def _load_film() -> Any:  # noqa: ANN401 - a function
    from contactlab.view.render import write_file

    return write_file


def _load_window() -> Any:  # noqa: ANN401 - a function
    from contactlab.view.render import open_viewer

    return open_viewer


def _load_geoms() -> Any:  # noqa: ANN401 - a function
    from contactlab.run.geom_naming import geom_replacers

    return geom_replacers


def _load_lock_schema() -> Any:  # noqa: ANN401 - a class
    from contactlab.studies.lock.lock_model import Lock

    return Lock


def _load_parity_schema() -> Any:  # noqa: ANN401 - a class
    from contactlab.studies.parity.parity_report import ParityReport

    return ParityReport


def _load_variants() -> Any:  # noqa: ANN401 - a function
    from contactlab.modifications.catalogue import list_variants

    return list_variants


def _load_advisories() -> Path:
    from contactlab.resources import ADVISORIES

    return ADVISORIES


def _load_fork_server() -> ModuleType:
    from contactlab.run import preloaded

    return preloaded


def _load_description(report: str) -> Any:  # noqa: ANN401, C901, PLR0912, PLR0915 - a function; a table
    match report:
        case "AdvisoriesCheck":
            from contactlab.studies.advisories.check_document import describe_check as describe
        case "DifferencesReport":
            from contactlab.studies.advisories.differences_document import (
                describe_differences as describe,
            )
        case "BudgetReport":
            from contactlab.reporting.budget_document import describe_budget as describe
        case "EffectsReport":
            from contactlab.studies.effects.effects_document import describe_effects as describe
        case "EnginePanel":
            from contactlab.studies.engine_panel.panel_document import describe_panel as describe
        case "FitReport":
            from contactlab.studies.fit.fit_document import describe_fit as describe
        case "GradientsReport":
            from contactlab.studies.gradients.gradients_document import (
                describe_gradients as describe,
            )
        case "GripReport":
            from contactlab.studies.grip.grip_document import describe_grip as describe
        case "ShrinkReport":
            from contactlab.studies.shrink.shrink_document import describe_shrinking as describe
        case "StabilityReport":
            from contactlab.reporting.stability_document import describe_stability as describe
        case "SuccessReport":
            from contactlab.studies.success.success_document import describe_success as describe
        case "TradeoffReport":
            from contactlab.pareto.tradeoff_document import describe_tradeoff as describe
        case "TuneReport":
            from contactlab.studies.search.tune_document import describe_tuning as describe
        case "DiffReport":
            from contactlab.studies.diff.compare_models import describe_diff as describe
        case "LintReport":
            from contactlab.studies.lint.linting import describe_lint as describe
        case "Examination":
            from contactlab.reporting.examination_document import describe_examination as describe
        case "Examinations":
            from contactlab.reporting.examination_document import describe_examinations as describe
        case "Explanation":
            from contactlab.reporting.explanation_document import describe_explanation as describe
        case "SweepForecast":
            from contactlab.reporting.store_reports_document import describe_forecast as describe
        case "StoreVerification":
            from contactlab.reporting.store_reports_document import (
                describe_verification as describe,
            )
        case "RunReplay":
            from contactlab.reporting.store_reports_document import describe_replay as describe
        case "Bisection":
            from contactlab.reporting.store_reports_document import describe_bisection as describe
        case "WrittenLock":
            from contactlab.reporting.store_reports_document import describe_lock as describe
        case "WrittenBaseline":
            from contactlab.reporting.store_reports_document import describe_baseline as describe
        case "ExpandedTraces":
            from contactlab.reporting.store_reports_document import describe_expansion as describe
        case "WrittenBundle":
            from contactlab.reporting.store_reports_document import describe_bundle as describe
        case _:
            raise KeyError(report)
    return describe


_DESCRIBED = (
    "AdvisoriesCheck",
    "DifferencesReport",
    "BudgetReport",
    "EffectsReport",
    "EnginePanel",
    "FitReport",
    "GradientsReport",
    "GripReport",
    "ShrinkReport",
    "StabilityReport",
    "SuccessReport",
    "TradeoffReport",
    "TuneReport",
    "DiffReport",
    "LintReport",
    "Examination",
    "Examinations",
    "Explanation",
    "SweepForecast",
    "StoreVerification",
    "RunReplay",
    "Bisection",
    "WrittenLock",
    "WrittenBaseline",
    "ExpandedTraces",
    "WrittenBundle",
)


def add_parts() -> None:
    """Add contactlab's own parts to the registry of this process."""
    for name in get_args(CommandModule):
        add_part("command module", partial(load_command, name), name)
    add_part("environment", _load_environment, "mujoco")
    add_part("executor", _load_ray, "ray")
    add_part("executor", _load_slurm, "slurm")
    add_part("store", _load_object_storage, "az", "gs", "s3")
    add_part("viewer", _load_film, "gif", "mcap", "mp4", "png", "rrd", "svg")
    add_part("viewer", _load_window, "window")
    add_part("wording", _load_geoms, "geoms")
    add_part("schema", _load_lock_schema, "lock")
    add_part("schema", _load_parity_schema, "parity")
    for report in _DESCRIBED:
        add_part("description", partial(_load_description, report), report)
    add_part("variants", _load_variants, "contactlab")
    add_part("advisory_folder", _load_advisories, "contactlab")
    add_part("fork server", _load_fork_server, "preloaded")


def register_parts() -> None:
    """Have this process, and workers that it starts, find contactlab's own parts."""
    fill_registry(add_parts)
