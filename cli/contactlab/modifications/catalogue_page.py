"""The page of the documentation that lists all modifications."""

from collections.abc import Iterator

from contactlab.modifications.catalogue import CATALOGUE
from contactlab.modifications.modification import Modification

_PAGE_HEAD = """\
# Modifications

Made from `cli/contactlab/modifications` by `make schemas`: edit an entry there, or add one.

A modification is something that a command may change in a model. Rows of the error budget, fixes
of an examination, levers of `tune`, features and parts that `effects` removes, fixes of a grip and
switches of the live page are read from this list. *kind* says whether it computes the same model in
another way (computation), or makes another model (model). *rows* are the rows of the error budget
that it answers. *labels* are those that it may remove. A *safeguard* protects runs that a task does
not show, so that nothing removes it. An entry without a use is not tried yet.
"""
_HEADER = ("modification", "edits", "kind", "rows", "labels", "used as")


def modifications_page() -> str:
    """Return the page that lists all modifications."""
    lines = [_PAGE_HEAD, _format_row(_HEADER), _format_row(["---"] * len(_HEADER))]
    lines += [_format_row(list(_list_cells(entry))) for entry in CATALOGUE.values()]
    return "\n".join(lines) + "\n"


def _format_row(cells: list[str] | tuple[str, ...]) -> str:
    return f"| {' | '.join(cells)} |"


def _list_cells(entry: Modification) -> Iterator[str]:
    safeguard = " A safeguard." if entry.safeguard else ""
    yield f"**{entry.name}**: {entry.summary}{safeguard}"
    yield ", ".join(f"`{name}`" for name in entry.edits)
    yield entry.kind
    yield ", ".join(entry.answered_rows)
    yield ", ".join(entry.labels)
    yield "; ".join(_list_uses(entry))


def _list_uses(entry: Modification) -> Iterator[str]:
    if entry.rows:
        yield f"row {', '.join(row.name for row in entry.rows)}"
    if entry.levers:
        yield f"lever {', '.join(f'`{lever.setting}`' for lever in entry.levers)}"
    if entry.features:
        yield f"feature {', '.join(feature.name for feature in entry.features)}"
    if entry.removals:
        yield f"part {', '.join(removal.kind for removal in entry.removals)}"
    if words := [one.name for one in entry.reductions if not one.is_exact]:
        yield f"`tune --apply {', '.join(words)}`"
    if entry.grip_fixes:
        causes = dict.fromkeys(fix.against for fix in entry.grip_fixes)
        yield f"fix of a grip against {', '.join(causes)}"
    if fixes := [fix.name for fix in entry.fixes]:
        yield f"fix {', '.join(fixes)}"
    if entry.part_fixes:
        yield f"fix `--apply {', '.join(fix.apply for fix in entry.part_fixes)}`"
