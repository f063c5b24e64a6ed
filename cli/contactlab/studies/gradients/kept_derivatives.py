"""Derivatives that a folder has of the same question, from which a map goes on where it ended."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from pydantic import TypeAdapter
from pydantic_core import to_json

from contactlab.plugins import hash_of_packages
from contactlab.resources import short_hash
from contactlab.run.evidence_record import definitions
from contactlab.schema.gradients import GradientBy
from contactlab.studies.session import Session

KEPT = "derivatives.json"
_Kept = dict[str, dict[str, list[GradientBy]]]  # by question, then by parameter and first place


@dataclass(frozen=True)
class KeptDerivatives:
    """Those of one question, in the session's folder."""

    session: Session
    question: str
    found: dict[str, list[GradientBy]] = field(default_factory=dict[str, list[GradientBy]])

    @classmethod
    def of(cls, session: Session, question: Mapping[str, object]) -> "KeptDerivatives":
        """Read what there is of a question, by the same code; an OutputError if it is damaged."""
        code = definitions(), hash_of_packages([__name__.rpartition(".")[0]])
        asked = short_hash([*code, to_json(question).decode()])
        return cls(session, asked, session.read(KEPT, _Kept).get(asked, {}))

    def get(self, parameter: str, first: int) -> Sequence[GradientBy] | None:
        """Return those with respect to a parameter from a place on; None if there are none."""
        return self.found.get(f"{parameter} {first}")

    def add(self, parameter: str, first: int, derivatives: Sequence[GradientBy]) -> None:
        """Keep some, beside those that there are of this question, and of no other."""
        self.found[f"{parameter} {first}"] = [*derivatives]
        text = TypeAdapter(_Kept).dump_json({self.question: self.found}).decode()
        self.session.write({KEPT: text + "\n"})
