"""The modules of commands, which the entry of the program registers; each is imported when used."""

from contactlab.command_line.declaration import Command, find_command, is_declared
from contactlab.registry import own_parts


def command_modules() -> tuple[str, ...]:
    """Return the names of modules, each the first word of its commands, sorted."""
    return tuple(own_parts("command module"))


def commands_of(name: str) -> list[Command]:
    """Return the commands that a module declares, in its order."""
    module = own_parts("command module")[name].load()
    commands = map(find_command, filter(is_declared, vars(module).values()))
    return [command for command in commands if command.function.__module__ == module.__name__]
