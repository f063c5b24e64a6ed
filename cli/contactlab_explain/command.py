"""`contactlab explain`: what a word means, and contact settings in units of the world."""

import tempfile
from pathlib import Path

import typer

from contactlab.commands.options import helped
from contactlab.commands.terminal import echo, study_session
from contactlab.errors import ExpectationError, SweepFileError


@helped(
    "explain chatter",
    'explain solref="0.005 1" MODEL        # its stiffness, damping, restitution, depth',
    'explain depth_at_rest=".1 mm" MODEL   # the solref for it, verified by a run',
    codes="0 printed, 1 a run does not show it, 2 bad input",
)
def explain(
    what: list[str] = typer.Argument(
        ..., metavar="WORD | [NAME=VALUE ...] MODEL", help="A label, metric, axis, or a model."
    ),
) -> None:
    """Say what a label, a metric or an axis is; or what the contacts of a model are."""
    from contactlab.resources import scene_names
    from contactlab_explain.contact_words import WORDS, explain_contacts, read_words
    from contactlab_explain.definitions import define, is_defined

    assign = [each for each in what if "=" in each]
    names = [each for each in what if "=" not in each]
    models = [x for x in names if x in scene_names() or "menagerie:" in x or Path(x).exists()]
    if not assign and (len(names) > 1 or is_defined(names[0]) or not models):
        echo("\n\n".join(map(define, names)))
        return
    if len(names) != 1:
        raise SweepFileError(f"{' '.join(assign)}: name one model after it")
    split = dict(each.split("=", 1) for each in assign)
    words = read_words({name: text for name, text in split.items() if name in WORDS})
    other = [f"{name}={text}" for name, text in split.items() if name not in WORDS]
    with tempfile.TemporaryDirectory() as folder, study_session(Path(folder), 0) as session:
        lines, missed = explain_contacts(names[0], other, words, session)
    echo("\n".join([*lines, *["shown by a run with these settings"] * bool(words and not missed)]))
    if missed:
        raise ExpectationError("\n".join(["a run does not show it:", *missed]))
