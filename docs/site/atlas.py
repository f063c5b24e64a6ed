"""The atlas: a table of public robots; of each a page, a JSON file and a badge, from records."""

import html
import shlex
from collections.abc import Iterator, Sequence
from pathlib import Path

from atlas.entry import Entry, entries

from contactlab.studies.examine.examination_lines import examination_lines

_STATIC = "_static/atlas"
_COLOURS = {
    "sound": "#3f7d58",
    "model": "#8a6d1d",
    "not sound": "#b3261e",
    "unresolved": "#b3261e",
    "not resolved": "#7a4b8f",
}
_WORDS = {"model": "softness decides"}
_SCRIPT = (Path(__file__).with_name("atlas.js")).read_text(encoding="utf-8")
_INTRODUCTION = """# Atlas of public robots

What `contactlab MODEL` says of robots and scenes as public wheels carry them, one of each family of
near-equal files: {judged} were examined, with MuJoCo {mujoco}; of {refused} families there is no
verdict. Each page has the command that says it again.

A verdict is on the model *under one task*: rest under neutral controls, then sines through its own
actuators and pushes, or a keyframe held by its own controls. It is no verdict on a robot, nor on
what a policy does with it. "Softness decides" is sound, as numerics go: how much the motion hangs
on soft contacts or limits is told, and may be meant.

**What is not known.** {silent} A change was judged again on fresh seeds, and, written into the
model, by the same command; a dash says that none was. Causes are looked for in plain MuJoCo by
`atlas/confirm.py`, whose controls are drawn anew: where it does not show them, the row says no.
Licences are those of wheels, and single models may have others.
"""
_SILENT = "Of {names} there was no answer within the limit of CPU."
_NONE = "-"
_HEAD = ("model", "verdict", "first change", "CPU s", "after it", "confirmed")


def write(source: Path) -> tuple[str, ...]:
    """Write the pages and files of all records; return the name of the first page."""
    known = list(entries())
    judged = [entry for entry in known if entry.examination]
    refused = [entry for entry in known if not entry.examination]
    for place in ("atlas", _STATIC):
        (source / place).mkdir(parents=True)
    for entry in judged:
        page = source / "atlas" / f"{slug(entry)}.md"
        page.write_text("\n".join(_page(entry)) + "\n", encoding="utf-8")
        files = source / _STATIC / slug(entry)
        files.with_name(f"{slug(entry)}.json").write_text(
            entry.model_dump_json(indent=2) + "\n", encoding="utf-8"
        )
        files.with_name(f"{slug(entry)}.svg").write_text(badge(entry), encoding="utf-8")
    text = "\n".join([*_index(judged, refused)])
    (source / "atlas.md").write_text(text + "\n", encoding="utf-8")
    return ("atlas",)


def slug(entry: Entry) -> str:
    """Return a robot's name as that of a file."""
    parts = entry.name.split("/")
    kept = [part for place, part in enumerate(parts) if part not in parts[:place]]
    return "-".join(kept).replace(".", "-")


def shown_word(entry: Entry) -> str:
    """Return the verdict as tables and badges have it."""
    return _WORDS.get(entry.word, entry.word)


def badge(entry: Entry) -> str:
    """Return a picture of the verdict, as pages of projects show them."""
    word, colour = shown_word(entry), _COLOURS[entry.word]
    right = 7 * len(word) + 12
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{76 + right}" height="20" role="img" '
        f'aria-label="contactlab: {word}"><rect width="76" height="20" fill="#444"/>'
        f'<rect x="76" width="{right}" height="20" fill="{colour}"/>'
        '<g fill="#fff" font-family="Verdana,sans-serif" font-size="11">'
        f'<text x="6" y="14">contactlab</text><text x="82" y="14">{word}</text></g></svg>\n'
    )


def first_change(entry: Entry) -> str:
    """Return the first change that removes the verdict, or ""."""
    changes = entry.examination.changes if entry.examination else ()
    removing = [change.name for change in changes if change.removes == "verdict"]
    return removing[0] if removing else ""


def answers(entry: Entry) -> tuple[str, str]:
    """Return what the change comes to, and whether plain MuJoCo shows the cause."""
    changed, shown = entry.changed, entry.confirmation
    after = _NONE if changed is None else "sound" if changed.sound else "not sound"
    if changed is not None and changed.nearer is False:
        after += ", no nearer"
    return after, _NONE if shown is None else "yes" if shown.holds else "no"


def _index(judged: Sequence[Entry], refused: Sequence[Entry]) -> Iterator[str]:
    slow = [entry.name for entry in refused if "CPU" in entry.refused]
    yield _INTRODUCTION.format(
        judged=len(judged),
        refused=len(refused),
        mujoco=", ".join(sorted({entry.mujoco for entry in judged})),
        silent=_SILENT.format(names=", ".join(f"`{name}`" for name in slow)) if slow else "",
    )
    yield '```{raw} html\n<p class="atlas-filter"><input type="search" aria-label="filter" '
    yield 'placeholder="filter: a robot, a wheel, a verdict, a change"> <span></span></p>'
    heads = "".join(f'<th scope="col"><button>{name}</button></th>' for name in _HEAD)
    yield f'<table class="atlas"><thead><tr>{heads}</tr></thead><tbody>'
    yield from map(_row, judged)
    yield f"</tbody></table>\n<script>\n{_SCRIPT}</script>\n```\n"
    pages = "\n".join(f"atlas/{slug(entry)}" for entry in judged)
    yield f"```{{toctree}}\n:hidden:\n\n{pages}\n```\n"
    yield "## Without a verdict\n"
    yield from (f"- `{entry.name}`: {_plain(entry.refused)}" for entry in refused)


def _row(entry: Entry) -> str:
    after, shown = answers(entry)
    dot = f'<i style="background:{_COLOURS[entry.word]}"></i>'
    name = entry.name.removeprefix(f"{entry.wheel}/")
    link = f'<a href="{slug(entry)}/">{html.escape(_short(name))}</a><small>{entry.wheel}</small>'
    change = html.escape(first_change(entry)) or _NONE
    cells = (link, f"{dot}{shown_word(entry)}", change, f"{entry.cpu:.0f}", after, shown)
    return f"<tr>{''.join(f'<td>{cell}</td>' for cell in cells)}</tr>"


def _short(name: str) -> str:
    """Return the last parts of a path that tell a robot from others."""
    folder, file = name.split("/")[-2:] if "/" in name else ("", name)
    return f"{folder}/{file}" if folder else file


def _page(entry: Entry) -> Iterator[str]:
    report = entry.examination
    assert report is not None
    name, page = entry.name, slug(entry)
    yield f"# {_short(name)}\n\n![contactlab: {shown_word(entry)}](../{_STATIC}/{page}.svg)\n"
    yield f"```text\n{chr(10).join(examination_lines(report))}\n```\n"
    yield "## What was tried\n"
    yield from _tried(entry)
    yield "\n## Where it is from\n"
    command = shlex.join(["contactlab", name])
    yield f"`{name}` of the wheel {entry.wheel} {entry.version}, whose licence is"
    yield f"{entry.licence or 'not stated in its metadata'}. It stands for {len(entry.family)} of"
    yield f"its family. Lint finds {_counted(entry.lint)}; the command took {entry.cpu:.0f} s of"
    yield "CPU.\n"
    yield f"```sh\n{command}   # in a folder where each wheel is unpacked into its own\n```\n"
    yield f"[All of it as JSON](../{_STATIC}/{page}.json), judged by contactlab {entry.contactlab}"
    yield f"with MuJoCo {entry.mujoco}: code {entry.judge[:12]}, file {entry.digest[:12]}."


def _tried(entry: Entry) -> Iterator[str]:
    changed, shown = entry.changed, entry.confirmation
    if changed is not None:
        kind = "another model" if changed.physics else "the same model, computed otherwise"
        near = "is nearer" if changed.nearer else "was not shown to be nearer"
        yield f"- With {changed.name} ({kind}), the same command says:"
        yield f"  *{_plain(changed.sentence)}*. It {near} to the original at its finest step than"
        yield "  before."
    elif entry.flagged:
        yield "- No change of those that were tried removes it, so none was written."
    else:
        yield "- Nothing to change."
    if shown is not None:
        word = "shows it" if shown.holds else "does not show it"
        command = shown.command.replace("\n", "\n  ")
        yield f"- Plain MuJoCo {word}: {_plain(shown.shown)}.\n\n  ```sh\n  {command}\n  ```"


def _counted(found: dict[str, int]) -> str:
    parts = [f"{count} {word}{'s' * (count != 1)}" for word, count in found.items() if count]
    return ", ".join(parts) or "nothing"


def _plain(text: str) -> str:
    """Return a text whose characters mean nothing to Markdown."""
    return "".join(f"\\{char}" if char in "\\`*_{}[]<>#|" else char for char in text)
