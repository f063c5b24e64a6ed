"""The words of the command line: parsed into a command's parameters, and its result printed."""

import inspect
import math
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import date, datetime
from typing import Annotated, Any, Literal, get_args, get_origin

import typer

from contactlab.command_line.declaration import Argument, Arguments, Command, Option, Parameter
from contactlab.command_line.surroundings import within
from contactlab.command_line.terminal import Terminal, notice, say
from contactlab.errors import CommandLineError, StoppedError, check_digits, suggestion

_FORMAT, _CONTEXT = "format", "context"
# The parser's words for mistakes that have no class of their own.
_EXTRA = re.compile(r"unexpected extra argument[s()]* \((.*)\)")
_WITHOUT_VALUE = re.compile(r"Option '(.*)' requires an argument")
_NO_COMMAND = re.compile(r"No such command '(.*?)'")


def adapt_command(
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
        parameters += map(_typed_parameter, own)
    if not in_list and len(command.formats) > 1:
        formats = tuple(command.formats)
        form_option = typer.Option(
            formats[0],
            "--format",
            help="How results are printed.",
            parser=_word_of("--format", formats),
            metavar="|".join(formats),
        )
        kind = inspect.Parameter.KEYWORD_ONLY
        parameters.append(inspect.Parameter(_FORMAT, kind, default=form_option, annotation=str))

    def run(**values: Any) -> None:  # noqa: ANN401 - of all types
        context = values.pop(_CONTEXT, None)
        if context is None or context.invoked_subcommand is None:
            call_command(command, values)

    run.__doc__ = (command.function.__doc__ or "").partition("\n")[0]
    run.__module__ = command.function.__module__
    run.__dict__["__signature__"] = inspect.Signature(parameters)
    run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    return run


def call_command(command: Command, values: Arguments) -> None:
    """Call a command with the values that typer read, print its result, and raise its failure."""
    if command.group != "extend":
        notice.show()
    chosen = values.get(_FORMAT) if len(command.formats) > 1 else next(iter(command.formats), None)
    own = inspect.signature(command.function)
    arguments = {name: values[name] for name in own.parameters if _is_given(values[name])}
    bound = own.bind_partial(**arguments)
    bound.apply_defaults()
    notice.interruption = command.describe_interruption(bound.arguments) if command.keeps else ""
    try:
        with within(Terminal()):
            result = command.function(**arguments)
            if chosen is not None:
                command.formats[chosen](result, bound.arguments)
    except (KeyboardInterrupt, StoppedError) as error:
        if notice.interruption:
            say(notice.interruption)
        raise typer.Exit(StoppedError.exit_code) from error
    if failure := command.failure(result, bound.arguments):
        raise failure


def _is_given(value: object) -> bool:
    """Return whether the command line has a value, in place of Python's default."""
    return value is not None and value != []


def _typed_parameter(own: inspect.Parameter) -> inspect.Parameter:
    """Return a parameter as typer reads it."""
    kind, described = described_type(own)
    default = ... if own.default is own.empty else own.default or None
    rules: dict[str, Any] = {"help": described.help, "metavar": described.metavar}
    rules |= _reading_options(kind, own.name, described)
    if isinstance(described, Option):
        if isinstance(own.default, bool | int | float):
            default = own.default
        name = _spell_option(own.name)
        name += f"/--no-{name[2:]}" if own.default is True else ""
        typer_parameter = typer.Option(default, *filter(None, (described.short, name)), **rules)
    else:
        typer_parameter = typer.Argument(default, **rules)
    return inspect.Parameter(own.name, own.KEYWORD_ONLY, default=typer_parameter, annotation=kind)


def described_type(own: inspect.Parameter) -> tuple[Any, Parameter]:
    """Return the type that the command line reads for a parameter, and its description."""
    if get_origin(own.annotation) is not Annotated:
        raise TypeError(f"{own}: annotate the parameter with an Option or an Argument")
    kind, *metadata = get_args(own.annotation)
    described = next(entry for entry in metadata if isinstance(entry, Argument | Option))
    kind = kind if described.kind is None else described.kind
    return kind if own.default is not None or described.kind is None else kind | None, described


def _reading_options(kind: Any, name: str, described: Parameter) -> dict[str, Any]:  # noqa: ANN401 - a type
    """Return the reader of a number or of one of few words; empty if typer reads the type."""
    if described.formats:
        return {"parser": _day_of(_spell_option(name), described.formats), "metavar": "DAY"}
    kinds = [part for part in get_args(kind) if part is not type(None)] or [kind]
    words = get_args(kinds[0]) if get_origin(kinds[0]) is Literal else ()
    words = tuple(kinds) if get_origin(kind) is Literal else words
    if words:
        metavar = described.metavar or "|".join(words)
        return {"parser": _word_of(_spell_option(name), words), "metavar": metavar}
    if kinds in ([int], [float]):
        read_number = _number_of(_spell_option(name), described.least, whole=kinds == [int])
        return {
            "parser": read_number,
            "metavar": described.metavar or ("N" if kinds == [int] else "X"),
        }
    return {}


def _word_of(name: str, words: Sequence[str]) -> Callable[[str], str]:
    def read(text: str) -> str:
        CommandLineError.unless_known(
            text, words, f"{name} {text}: write one of {', '.join(words)}"
        )
        return text

    return read


def _number_of(name: str, least: float | None, *, whole: bool) -> Callable[[Any], float]:
    expected = "a whole number" if whole else "a number"
    expected += "" if least is None else f" of at least {least:g}"

    def read(text: Any) -> float:  # noqa: ANN401 - a default is a number already
        try:
            if isinstance(text, str):
                check_digits(text)
            value = int(text) if whole else float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value) or value < (-math.inf if least is None else least):
            raise CommandLineError(f"{name} {text}: write {expected}")
        return value

    return read


def _day_of(name: str, formats: Sequence[str]) -> Callable[[Any], datetime]:
    some_day = date(2030, 12, 31)

    def read(text: Any) -> datetime:  # noqa: ANN401 - a default is a day already
        for form in formats:
            with suppress(ValueError):
                return datetime.strptime(text, form)  # noqa: DTZ007 - a day has no time
        raise CommandLineError(f"{name} {text}: write a day, such as {some_day:{formats[0]}}")

    return read


def explain_mistake(error: typer.TyperException, words: Sequence[str]) -> CommandLineError:
    """Return the error of a command line: the wrong word, and what to write instead."""
    message = error.format_message()
    path = getattr(getattr(error, "ctx", None), "command_path", None)
    path = path or " ".join(["contactlab", *words[:1]])
    command, help_text = f"`{path}`", f"see `{path} --help`"
    if option_name := getattr(error, "option_name", None):
        near = [*(getattr(error, "possibilities", None) or ())]
        if match := _WITHOUT_VALUE.search(message):
            return CommandLineError(f"{match[1]} needs a value; {help_text}")
        hint = suggestion(option_name, near, alike=0.75) or help_text
        return CommandLineError(f"{command} has no option '{option_name}'; {hint}")
    parameter = getattr(error, "param", None)
    if parameter and message.startswith("Missing"):
        name = (parameter.metavar or parameter.name).upper().replace("_", "-")
        parameter_text = name if parameter.param_type_name == "argument" else parameter.opts[-1]
        about = f": {parameter.help.rstrip('.')}" if parameter.help else ""
        return CommandLineError(f"{command} needs {parameter_text}{about}; {help_text}")
    if extra := _EXTRA.search(message):
        return CommandLineError(f"{command} takes no further '{extra[1]}'; {help_text}")
    if unknown := _NO_COMMAND.search(message):
        inner = sorted(getattr(getattr(error, "cmd", None), "commands", ()))
        hint = suggestion(unknown[1], inner) or f"write one of {', '.join(inner)}"
        return CommandLineError(f"{command} has no command '{unknown[1]}'; {hint}")
    return CommandLineError(f"{message[:1].lower()}{message[1:].rstrip('.')}; {help_text}")


def _spell_option(name: str) -> str:
    return f"--{name.rstrip('_').replace('_', '-')}"
