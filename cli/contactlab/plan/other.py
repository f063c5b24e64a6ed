"""Other files that people write, read like sweep files: all mistakes at once, with their places."""

from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from contactlab.plan.diagnostic import SweepMistakesError
from contactlab.plan.document import read_document
from contactlab.plan.mistakes import note_mistakes
from contactlab.plan.reading import read_text

_Kind = TypeVar("_Kind", bound=BaseModel)


def read_as(path: Path, kind: type[_Kind]) -> _Kind:
    """Read a YAML file as a model.

    Raises:
        SweepFileError: it cannot be read, or (as SweepMistakesError, with all of them as data) it
            holds mistakes.
    """
    document = read_document(read_text(path), str(path))
    if not document.has_errors:
        try:
            return kind.model_validate(document.data)
        except ValidationError as error:
            note_mistakes(document, error, kind)
    raise SweepMistakesError(document.found)
