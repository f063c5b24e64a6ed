"""Comments that ignore rules: `<!-- contactlab: ignore RULE -->`, or `# ...` in a scene.yaml.

A comment next to an element, or alone on the line above it, concerns that element. A comment next
to or above the first element of a file, or in the scene's manifest, concerns the whole model.
"""

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from contactlab.scene.model_text import elements_of, line_of
from contactlab.scene.scene_source import MODEL_SUFFIXES, SceneSource
from contactlab.studies.lint.linted_model import Place, shown_path

_COMMENT = re.compile(r"(?:<!--|#)\s*contactlab:\s*ignore\s+([\w-]+(?:\s*,\s*[\w-]+)*)([^\n]*)")
_ALONE = re.compile(r"\s*<!--(?:(?!-->).)*-->\s*")


@dataclass(frozen=True)
class Ignored:
    """Rules that comments of a model's files ignore.

    Attributes:
        everywhere: comment that ignores a rule in the whole model, by rule.
        by_line: comment that ignores a rule in a line, by file, line and rule.
    """

    everywhere: Mapping[str, str]
    by_line: Mapping[tuple[Path, int, str], str]

    def __call__(self, rule: str, place: Place) -> str | None:
        """Return the comment that ignores a rule at a place, or None."""
        lines = range(place.line, place.last + 1)
        reasons = (self.by_line.get((place.file, line, rule)) for line in lines)
        return next(filter(None, reasons), self.everywhere.get(rule))

    @property
    def rules(self) -> Mapping[str, str]:
        """Comment that ignores each rule, by rule."""
        return {**{rule: at for (_, _, rule), at in self.by_line.items()}, **self.everywhere}


def read_ignored_rules(source: SceneSource) -> Ignored:
    """Return the ignored rules of a scene's files."""
    everywhere, by_line = dict[str, str](), dict[tuple[Path, int, str], str]()
    for name in source.content.files:
        file = source.content.root / name
        is_model = file.suffix in MODEL_SUFFIXES
        if not is_model and file != source.path:
            continue
        data = file.read_bytes()
        elements = elements_of(data) if is_model else []
        first = line_of(data, elements[0].inner - 1) if elements else 0
        for line, text in enumerate(data.decode(errors="replace").splitlines(), 1):
            lists = [re.split(r"\s*,\s*", comment[1]) for comment in _COMMENT.finditer(text)]
            at = f"ignored in {shown_path(file)}:{line}"
            for rule in itertools.chain(*lists):
                if line <= first or not is_model:
                    everywhere[rule] = at
                else:
                    by_line[file, line, rule] = at
                    if _ALONE.fullmatch(text):
                        by_line[file, line + 1, rule] = at
    return Ignored(everywhere, by_line)
