"""The modules of commands: each is found by its name, and imported when the command is used."""

from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from contactlab.command_line.declaration import Command, declared, is_declared
from contactlab.resources import COMMANDS


@cache
def command_modules() -> tuple[str, ...]:
    """Return the names of modules, each the first word of its commands, sorted."""
    return tuple(sorted(module.name for module in iter_modules([str(COMMANDS)])))


def commands_of(name: str) -> list[Command]:
    """Return the commands that a module declares, in its order."""
    module = import_module(f"contactlab.commands.{name}")
    found = map(declared, filter(is_declared, vars(module).values()))
    return [command for command in found if command.function.__module__ == module.__name__]
