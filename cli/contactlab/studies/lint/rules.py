"""The rules of lint, and the decorator that declares one."""

import inspect
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from contactlab.registry import Registry
from contactlab.schema.finding import Level
from contactlab.studies.lint.linted_model import Fault, LintedModel

RuleFunction = Callable[[LintedModel], Iterator[Fault]]
DOCS = "docs/lint.md"


@dataclass(frozen=True)
class Rule:
    """One thing that a model should not have.

    Attributes:
        name: its id, in reports and in comments that ignore it.
        level: of its findings: a gate is an error, which no author means.
        function: yields where a model breaks it.
        of_refused: whether it also judges what MuJoCo does not compile.
    """

    name: str
    level: Level
    function: RuleFunction
    of_refused: bool = False

    @property
    def about(self) -> str:
        """What it says, in a sentence."""
        return (inspect.getdoc(self.function) or "").partition("\n")[0]

    @property
    def docs(self) -> str:
        """Where its reason, an example and the remedy are."""
        return f"{DOCS}#{self.name}"


RULES: Registry[Rule] = Registry("rule")


def rule(
    name: str, level: Level, *, of_refused: bool = False
) -> Callable[[RuleFunction], RuleFunction]:
    """Declare a rule: the function yields where a `LintedModel` breaks it.

    Its docstring begins with the sentence that reports have. A PluginError if a name is taken.
    """

    def declare(function: RuleFunction) -> RuleFunction:
        RULES.add(Rule(name, level, function, of_refused))
        return function

    return declare
