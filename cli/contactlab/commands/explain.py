"""`contactlab explain`: definitions of words."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, command
from contactlab.command_line.report_formats import report_formats
from contactlab.errors import SweepFileError

if TYPE_CHECKING:
    from contactlab.schema.explanation import Explanation


@command(
    "extend",
    examples=("explain chatter", "explain numerical error"),
    formats=report_formats(),
)
def explain(
    words: Annotated[
        str | Sequence[str],
        Argument("WORD", "A printed word; all by default.", kind=list[str]),
    ] = (),
    *,
    plugin: opt.Plugins = (),
) -> "Explanation":
    """Explain a word of the output, or list all.

    Raises:
        SweepFileError: a word has no definition.
    """
    from contactlab.resources import scene_names
    from contactlab.schema.explanation import Explanation
    from contactlab.studies.explain.definitions import (
        define_word,
        is_defined,
        list_words,
        words_of,
    )

    opt.load_plugins(plugin)
    if not words:
        return Explanation(meanings=list_words())
    names = words_of([words] if isinstance(words, str) else [*words])
    for name in names:
        if not is_defined(name) and (name in scene_names() or set(name) & set("=./:")):
            raise SweepFileError(
                f"{name}: explain defines words; the contacts of a model are a section: "
                "contactlab examine MODEL --section contacts"
            )
    return Explanation(meanings=tuple(meaning for name in names for meaning in define_word(name)))
