"""The rules of lint, and the decorator that declares one."""

import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from contactlab.registry import Registry
from contactlab.schema.examination import Stage
from contactlab.schema.finding import Level
from contactlab.studies.lint.linted_model import Fault, LintedModel

RuleFunction = Callable[[LintedModel], Iterator[Fault]]
DOCS = "docs/reference/lint.md"


@dataclass(frozen=True)
class Rule:
    """A lint rule.

    Attributes:
        name: its id, in reports and in comments that ignore it.
        level: of its findings: a gate is an error, which no author intends.
        function: yields the faults of a model.
        of_refused: whether it also judges models that MuJoCo does not compile.
        voids_runs: whether runs of such a model say nothing of the one that its author meant.
        voids_postures: whether runs from a keyframe do, since motors hold its posture.
        voids_starts: whether a run from the keyframe that a finding names is not the intended one.
        cause: stage of the fault if a verdict may follow from it, so that its edit is tried.
    """

    name: str
    level: Level
    function: RuleFunction
    of_refused: bool = False
    voids_runs: bool = False
    voids_postures: bool = False
    voids_starts: bool = False
    cause: Stage | None = None

    @property
    def about(self) -> str:
        """The rule in a sentence."""
        return (inspect.getdoc(self.function) or "").partition("\n")[0]

    @property
    def details(self) -> str:
        """Its criterion and its fix, in one line."""
        details = (inspect.getdoc(self.function) or "").partition("\n\n")[2]
        return " ".join(details.split())

    @property
    def docs(self) -> str:
        """Link to its reason, an example and the fix."""
        return f"{DOCS}#{self.name}"


RULES: Registry[Rule] = Registry("rule")


def rule(
    name: str,
    level: Level,
    *,
    of_refused: bool = False,
    voids_runs: bool = False,
    voids_postures: bool = False,
    voids_starts: bool = False,
    cause: Stage | None = None,
) -> Callable[[RuleFunction], RuleFunction]:
    """Declare a rule: the function yields the faults of a `LintedModel`.

    The first line of its docstring is used in reports. A PluginError if a name is taken.
    """

    def declare(function: RuleFunction) -> RuleFunction:
        voids = voids_runs, voids_postures, voids_starts
        RULES.add(Rule(name, level, function, of_refused, *voids, cause))
        return function

    return declare
