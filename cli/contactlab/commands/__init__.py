"""The commands: each module has the function of its name; one that groups several has them all."""

from types import ModuleType
from typing import Literal

CommandModule = Literal[
    "advisories",
    "bisect",
    "compare",
    "diff",
    "effects",
    "examine",
    "explain",
    "fit",
    "gradients",
    "grip",
    "init",
    "lint",
    "list",
    "lock",
    "parity",
    "render",
    "report",
    "show",
    "shrink",
    "stability",
    "success",
    "sweep",
    "tradeoff",
    "tune",
    "verify",
]
"""The names of the modules, sorted."""


def load_command(name: CommandModule) -> ModuleType:  # noqa: C901, PLR0912, PLR0915 - a table
    """Import and return the module of a command."""
    match name:
        case "advisories":
            from contactlab.commands import advisories as module
        case "bisect":
            from contactlab.commands import bisect as module
        case "compare":
            from contactlab.commands import compare as module
        case "diff":
            from contactlab.commands import diff as module
        case "effects":
            from contactlab.commands import effects as module
        case "examine":
            from contactlab.commands import examine as module
        case "explain":
            from contactlab.commands import explain as module
        case "fit":
            from contactlab.commands import fit as module
        case "gradients":
            from contactlab.commands import gradients as module
        case "grip":
            from contactlab.commands import grip as module
        case "init":
            from contactlab.commands import init as module
        case "lint":
            from contactlab.commands import lint as module
        case "list":
            from contactlab.commands import list as module
        case "lock":
            from contactlab.commands import lock as module
        case "parity":
            from contactlab.commands import parity as module
        case "render":
            from contactlab.commands import render as module
        case "report":
            from contactlab.commands import report as module
        case "show":
            from contactlab.commands import show as module
        case "shrink":
            from contactlab.commands import shrink as module
        case "stability":
            from contactlab.commands import stability as module
        case "success":
            from contactlab.commands import success as module
        case "sweep":
            from contactlab.commands import sweep as module
        case "tradeoff":
            from contactlab.commands import tradeoff as module
        case "tune":
            from contactlab.commands import tune as module
        case "verify":
            from contactlab.commands import verify as module
    return module
