"""`contactlab explain`: definitions of words, and contact settings in units of the world."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line import options as opt
from contactlab.command_line.declaration import Argument, Given, command
from contactlab.command_line.report_formats import report_formats
from contactlab.command_line.surroundings import study_session
from contactlab.errors import ExpectationError, SweepFileError

if TYPE_CHECKING:
    from contactlab.schema.explanation import Explanation


def _failure(found: "Explanation", given: Given) -> ExpectationError | None:
    del given
    if not found.missed:
        return None
    return ExpectationError("\n".join(["a run does not reach it:", *found.missed]))


@command(
    "examine",
    examples=(
        "explain chatter",
        "explain numerical error",
        'explain solref="0.005 1" MODEL        # its stiffness, damping, restitution, depth',
        'explain depth_at_rest=".1 mm" MODEL   # the solref for it, verified by a run',
    ),
    codes="0 printed, 1 a run does not reach it, 2 bad input",
    formats=report_formats(),
    failure=_failure,
)
def explain(
    what: Annotated[
        str | Sequence[str],
        Argument(
            "WORD | [NAME=VALUE ...] MODEL",
            "Any word that contactlab prints, or a model.",
            kind=list[str],
        ),
    ],
    *,
    keyframe: opt.Keyframe = None,
    drive: opt.Drive = None,
    duration: opt.Duration = None,
    plugin: opt.Plugins = (),
) -> "Explanation":
    """Explain a word of the output, or the contacts of a model.

    Raises:
        SweepFileError: a word has no definition, or settings do not belong to one model.
        SceneError: the model does not compile.
    """
    from contactlab.resources import scene_names
    from contactlab.schema.explanation import Explanation
    from contactlab.studies.explain.contact_words import WORDS, explain_contacts, read_words
    from contactlab.studies.explain.definitions import define_word, is_defined, words_of

    opt.load_plugins(plugin)
    words = [what] if isinstance(what, str) else what
    assign = [word for word in words if "=" in word]
    names = words_of([word for word in words if "=" not in word])
    models = [name for name in names if name in scene_names() or set(name) & set(":./")]
    if len(models) > 1:
        raise SweepFileError(f"{' and '.join(models)}: name one model; each has its own contacts")
    if not assign and (len(names) > 1 or is_defined(names[0]) or not models):
        return Explanation(meanings=tuple(found for name in names for found in define_word(name)))
    if len(names) != 1:
        raise SweepFileError(f"{' '.join(assign)}: name one model after it")
    task = opt.task_of(keyframe, drive, duration)
    split = dict(each.split("=", 1) for each in assign)
    wanted = read_words({name: text for name, text in split.items() if name in WORDS})
    other = [f"{name}={text}" for name, text in split.items() if name not in WORDS]
    with tempfile.TemporaryDirectory() as folder, study_session(Path(folder), 0) as session:
        return explain_contacts(names[0], other, wanted, session, task)
