"""Declarations of commands: a function with annotated parameters, which are its options.

    @command("list", examples=("ring ding",))
    def ring(
        bell: Annotated[str, Argument("BELL", "Which one.")],
        times: Annotated[int, Option("N", "How often.", least=1)] = 1,
    ) -> Rung:
        ...

Python calls the function: it returns data, prints nothing, and raises a ContactlabError. The
command line parses its words into the same parameters, calls the same function, and prints the
result. A parameter `retry_failed` is the option `--retry-failed`; a name that is a keyword
of Python ends with `_`.
"""

import inspect
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import wraps
from typing import Any, Literal, ParamSpec, TypeVar, get_args, get_type_hints

from contactlab.command_line.surroundings import progress
from contactlab.errors import ContactlabError, ExpectationError, PluginError

Group = Literal["examine", "run", "read", "gate", "extend"]
"""Kind of a command, by its purpose."""
TITLES: Mapping[Group, str] = {
    "examine": "Judge and improve a model",
    "run": "Run sweeps",
    "read": "Read evidence",
    "gate": "Gate changes",
    "extend": "Look up",
}
"""Titles of groups, in the order of `--help`."""
_OF_RUNS = (
    "0 as expected, 1 not as expected, 2 bad input, 3 bad store, 4 runs lost, 130 interrupted"
)
_OF_STORES = "0 sound or equal, 1 different, 2 bad input, 3 bad or damaged store"
CODES: Mapping[Group, str] = {
    "examine": _OF_RUNS,
    "run": _OF_RUNS,
    "read": _OF_STORES,
    "gate": _OF_STORES,
    "extend": "0 printed, 2 bad input",
}
"""Exit codes of the commands of a group, except those with codes of their own."""

Arguments = Mapping[str, Any]
"""The parameters of a call by name, with the defaults of those that are left out."""
Keeps = Literal["finished runs", "finished parts", "nothing"]
"""The results that an interrupted command keeps for its next call."""
Show = Callable[[Any, Arguments], None]
"""Prints the result of a command."""

_Parameters = ParamSpec("_Parameters")
_Result = TypeVar("_Result")


@dataclass(frozen=True)
class Parameter:
    """Name, explanation and type of a parameter on the command line."""

    metavar: str | None
    help: str
    # The type that typer reads, if Python takes more than that: `list[str]` may be repeated.
    kind: Any = None
    least: float | None = None  # the smallest number
    formats: Sequence[str] = ()  # of a date


@dataclass(frozen=True)
class Argument(Parameter):
    """A parameter without a name on the command line, by its place."""


@dataclass(frozen=True)
class Option(Parameter):
    """A parameter `--name VALUE`."""

    short: str | None = None  # such as `-o`


def flag(help: str) -> Option:  # noqa: A002 - as typer calls it
    """Return an option that takes no value; one that is on by default has a `--no-` form."""
    return Option(None, help, kind=bool)


def _problem_of(result: object, arguments: Arguments) -> ContactlabError | None:
    """Return the error of a report with a problem; other results have none."""
    del arguments
    problem = getattr(result, "problem", "")
    return ExpectationError(problem) if problem else None


@dataclass(frozen=True)
class Command:
    """A declared command."""

    function: Callable[..., Any]
    name: str  # its words, such as `advisories check`
    group: Group
    examples: Sequence[str]
    codes: str
    # Prints results, by the name that `--format` gives it; the first is the default. One alone, and
    # there is no such option.
    formats: Mapping[str, Show] = field(default_factory=dict[str, Show])
    # Returns the error that the command line ends with, once a result is printed.
    failure: Callable[[Any, Arguments], ContactlabError | None] = _problem_of
    # Results that stay after Ctrl-C; None for a command that ends at once.
    keeps: "Keeps | Callable[[Arguments], Keeps] | None" = None

    def describe_interruption(self, arguments: Arguments) -> str:
        """Return one line: the results that stay after Ctrl-C, and the next step."""
        keeps = self.keeps(arguments) if callable(self.keeps) else self.keeps
        if keeps == "nothing":
            return "interrupted; nothing is kept: run the same command again to start over"
        return f"interrupted; {keeps} are kept: run the same command again to resume"

    @property
    def end_of_help(self) -> str:
        """End of its help: examples and exit codes."""
        lines = "\n".join(f"  contactlab {line}" for line in self.examples)
        return f"\b\nExamples:\n{lines}\n\nExit codes: {self.codes}."


def command(
    group: Group,
    *,
    name: str | None = None,
    examples: Sequence[str] = (),
    codes: str | None = None,
    formats: Mapping[str, Show] | None = None,
    failure: Callable[[Any, Arguments], ContactlabError | None] = _problem_of,
    keeps: Keeps | Callable[[Arguments], Keeps] | None = None,
) -> Callable[[Callable[_Parameters, _Result]], Callable[_Parameters, _Result]]:
    """Declare a function as a command of the command line, by its own name unless another is given.

    Args:
        group: kind of the command, which orders `--help` and gives the exit codes.
        name: its words, if they are not the name of the function.
        examples: command lines without the word `contactlab`; its name alone if left out.
        codes: exit codes, if they are not those of the group.
        formats: printers of its result, by the name that `--format` takes.
        failure: returns the error to end with, from result and parameters; None if it is fine.
        keeps: results that stay after Ctrl-C, of a command that may take long.

    Raises:
        PluginError: there is no such group.
    """

    def declare(function: Callable[_Parameters, _Result]) -> Callable[_Parameters, _Result]:
        words = name or function.__name__
        PluginError.unless_known(group, CODES, f"{words}: no group '{group}' of commands")

        @wraps(function)
        def call(*args: _Parameters.args, **keywords: _Parameters.kwargs) -> _Result:
            own: dict[str, Any] = dict(keywords)
            with progress(own.pop("progress", None)):
                return function(*args, **own)  # pyright: ignore[reportCallIssue]

        if function.__code__.co_flags & inspect.CO_VARKEYWORDS:
            call.__dict__["__signature__"] = _spelled_out(inspect.signature(function))
        call.__dict__["command"] = Command(
            call,
            words,
            group,
            examples or (words,),
            codes or CODES[group],
            formats or {},
            failure,
            keeps,
        )
        return call

    return declare


def _spelled_out(own: inspect.Signature) -> inspect.Signature:
    """Return a signature that ends with keywords of a TypedDict with each as a parameter.

    Those that may be repeated are () by default, others None.
    """
    *parameters, keywords = own.parameters.values()
    (shape,) = get_args(keywords.annotation)
    new_parameters = list[inspect.Parameter]()
    for name, annotation in get_type_hints(shape, include_extras=True).items():
        described = next(entry for entry in get_args(annotation) if isinstance(entry, Parameter))
        default = () if described.kind == list[str] else None
        new_parameters.append(
            inspect.Parameter(
                name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation
            )
        )
    return own.replace(parameters=[*parameters, *new_parameters])


def is_declared(function: object) -> bool:
    """Return whether a function is declared as a command."""
    return isinstance(getattr(function, "__dict__", {}).get("command"), Command)


def find_command(function: object) -> Command:
    """Return the command that a function is declared as; raise PluginError for other objects."""
    if not is_declared(function):
        raise PluginError(f"{function} is not a command; declare it with {__name__}.command")
    return function.__dict__["command"]
