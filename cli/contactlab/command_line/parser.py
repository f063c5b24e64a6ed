"""The words of the command line: parsed into a command's parameters, and its result printed."""

import inspect
from collections.abc import Callable, Iterator
from typing import Annotated, Any, Literal, get_args, get_origin

import typer

from contactlab.command_line.declaration import Argument, Command, Given, Option, Parameter
from contactlab.command_line.surroundings import within
from contactlab.command_line.terminal import Terminal, notice

_FORMAT, _CONTEXT = "format", "context"


def typed(
    command: Command, *, in_list: bool = False, of_group: bool = False
) -> Callable[..., None]:
    """Return a command as a function that typer can read: it calls, prints and fails.

    In a list of commands it has no parameters, which take a while to make. That of a group is
    called when none of the group's commands is.
    """
    parameters: list[inspect.Parameter] = []
    if of_group:
        kind = inspect.Parameter.KEYWORD_ONLY
        parameters.append(inspect.Parameter(_CONTEXT, kind, annotation=typer.Context))
    if not in_list:
        own = inspect.signature(command.function).parameters.values()
        parameters += [*map(_typed, own), *_format_options(command)]

    def run(**values: Any) -> None:  # noqa: ANN401 - of all types
        context = values.pop(_CONTEXT, None)
        if context is None or context.invoked_subcommand is None:
            call(command, values)

    run.__doc__ = (command.function.__doc__ or "").partition("\n")[0]
    run.__module__ = command.function.__module__
    run.__dict__["__signature__"] = inspect.Signature(parameters)
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def call(command: Command, values: Given) -> None:
    """Call a command with the values that typer read, print its result, and raise its failure."""
    if command.group != "extend":
        notice.show()
    chosen = values.get(_FORMAT) if len(command.formats) > 1 else next(iter(command.formats), None)
    own = inspect.signature(command.function)
    given = {name: values[name] for name in own.parameters if _is_given(values[name])}
    bound = own.bind_partial(**given)
    bound.apply_defaults()
    with within(Terminal()):
        result = command.function(**given)
        if chosen is not None:
            command.formats[chosen](result, bound.arguments)
    if failure := command.failure(result, bound.arguments):
        raise failure


def _is_given(value: object) -> bool:
    """Return whether the command line has a value, in place of Python's default."""
    return value is not None and value != []


def _typed(own: inspect.Parameter) -> inspect.Parameter:
    """Return a parameter as typer reads it."""
    kind, described = described_type(own)
    default = ... if own.default is own.empty else own.default or None
    rules: dict[str, Any] = {"help": described.help, "metavar": described.metavar}
    if described.least is not None:
        rules["min"] = described.least
    if described.formats:
        rules["formats"] = list(described.formats)
    if isinstance(described, Option):
        if isinstance(own.default, bool | int | float):
            default = own.default
        read = typer.Option(default, *_flags(own, described), **rules)
    else:
        read = typer.Argument(default, **rules)
    return inspect.Parameter(own.name, own.KEYWORD_ONLY, default=read, annotation=kind)


def described_type(own: inspect.Parameter) -> tuple[Any, Parameter]:
    """Return what the command line reads for a parameter, and how it is described."""
    if get_origin(own.annotation) is not Annotated:
        raise TypeError(f"{own}: annotate the parameter with an Option or an Argument")
    kind, *found = get_args(own.annotation)
    described = next(entry for entry in found if isinstance(entry, Argument | Option))
    kind = kind if described.kind is None else described.kind
    return kind if own.default is not None or described.kind is None else kind | None, described


def _flags(own: inspect.Parameter, option: Option) -> list[str]:
    name = f"--{own.name.rstrip('_').replace('_', '-')}"
    if own.default is True:
        name += f"/--no-{name[2:]}"
    return [*filter(None, (option.short,)), name]


def _format_options(command: Command) -> Iterator[inspect.Parameter]:
    """Yield the option that chooses among formats, if there are several."""
    if len(command.formats) > 1:
        names = tuple(command.formats)
        read = typer.Option(names[0], "--format", help="How results are printed.")
        # Typer shows the choices of a literal, which is made of the names as it runs.
        kind: Any = Literal
        yield inspect.Parameter(
            _FORMAT, inspect.Parameter.KEYWORD_ONLY, default=read, annotation=kind[names]
        )
