"""Stored derivatives of the same question, so that an interrupted map can be resumed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from pydantic import TypeAdapter
from pydantic_core import to_json

from contactlab.plugins import hash_of_packages
from contactlab.resources import short_hash
from contactlab.run.evidence_record import hash_definitions
from contactlab.schema.gradients import GradientInput
from contactlab.tasks.session import Session

CACHE_FILE = "derivatives.json"
_CachedDerivatives = dict[
    str, dict[str, list[GradientInput]]
]  # by question, then by parameter and first place


@dataclass(frozen=True)
class DerivativeCache:
    """Derivatives of one question, in the session's folder."""

    session: Session
    question: str
    derivatives: dict[str, list[GradientInput]] = field(
        default_factory=dict[str, list[GradientInput]]
    )

    @classmethod
    def of(cls, session: Session, question: Mapping[str, object]) -> "DerivativeCache":
        """Read the derivatives of a question and code; an OutputError if they are damaged."""
        code = hash_definitions(), hash_of_packages([__name__.rpartition(".")[0]])
        question_hash = short_hash([*code, to_json(question).decode()])
        return cls(
            session,
            question_hash,
            session.read(CACHE_FILE, _CachedDerivatives).get(question_hash, {}),
        )

    def get(self, parameter: str, first: int) -> Sequence[GradientInput] | None:
        """Return the derivatives with respect to a parameter from a place on, or None."""
        return self.derivatives.get(f"{parameter} {first}")

    def add(self, parameter: str, first: int, derivatives: Sequence[GradientInput]) -> None:
        """Store derivatives, and drop those of other questions."""
        self.derivatives[f"{parameter} {first}"] = [*derivatives]
        text = TypeAdapter(_CachedDerivatives).dump_json({self.question: self.derivatives}).decode()
        self.session.write({CACHE_FILE: text + "\n"})
