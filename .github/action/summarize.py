"""Write what a pull request shows of a sweep: `comment.md`, and annotations with file and line.

`python summarize.py SWEEP OUTPUT` reads OUTPUT/store, and OUTPUT/compare.json and .md where there
is a comparison; it prints the sweep's name.
"""

import json
import re
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import contactlab
from contactlab.printable import in_markdown
from contactlab.writers.github import write_annotations

MOST_CELLS = 12  # a side of the map
SQUARES = "🟥🟧🟨🟪🟦🟫⬛"
STABLE = "🟩"


def main(sweep: str, output: Path) -> None:
    """Write comment and annotations of a sweep whose results are in a folder."""
    store = contactlab.open(output / "store")
    runs = store.table.to_pylist()
    definition = json.loads(store.file("sweep.json").read_text(encoding="utf-8"))
    axes = [name for name, values in definition["resolved"]["axes"].items() if _is_axis(values)]
    compared = output / "compare.md"
    parts = [
        compared.read_text(encoding="utf-8") if compared.exists() else _headline(runs),
        *label_map(axes, runs),
    ]
    (output / "comment.md").write_text("\n".join(parts) + "\n", encoding="utf-8")
    failures = _failed_checks(output / "compare.json") if compared.exists() else _unmet(runs)
    text = "".join(f"{line}\n" for line in placed_annotations(sweep, failures))
    (output / "annotations.txt").write_text(text, encoding="utf-8")
    print(re.sub(r"[^A-Za-z0-9._-]+", "-", definition["name"]))  # noqa: T201


def _is_axis(values: object) -> bool:
    listed = values.get("values", values) if isinstance(values, dict) else values
    return not isinstance(listed, list) or len(listed) > 1


def _headline(runs: Sequence[dict[str, Any]]) -> str:
    judged = [run["expectation_met"] for run in runs if run["expectation_met"] is not None]
    crashed = sum(run["status"] != "ok" for run in runs)
    mark = "✅" if all(judged) and not crashed else "❌"
    said = f"{sum(judged)} of {len(judged)} stated runs are as expected" if judged else ""
    said = said or f"{sum(run['label'] == 'stable' for run in runs)} of {len(runs)} runs are stable"
    return f"### {mark} {said}" + (f", {crashed} crashed or timed out" if crashed else "") + "\n"


def label_map(axes: Sequence[str], runs: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Return a map in Markdown: the worst label of each cell of the two longest axes."""
    values = {axis: sorted({_value(run, axis) for run in runs}, key=_order) for axis in axes}
    longest = sorted(values, key=lambda axis: -len(values[axis]))[:2]
    if not runs or not longest or len(values[longest[0]]) > 5 * MOST_CELLS:
        return
    # The longer axis goes down the page, which has more room for it.
    down, across = longest[0], longest[1] if len(longest) > 1 else None
    columns = values[across][:MOST_CELLS] if across else [""]
    common = Counter(run["label"] for run in runs if run["label"] != "stable").most_common()
    squares = {label: SQUARES[min(i, len(SQUARES) - 1)] for i, (label, _) in enumerate(common)}
    squares["stable"] = STABLE
    cells: dict[tuple[str, str], Counter[str]] = {}
    for run in runs:
        place = _value(run, down), _value(run, across) if across else ""
        cells.setdefault(place, Counter())[run["label"]] += 1
    names = [in_markdown(f"{across}={each}") if across else "" for each in columns]
    yield f"| {in_markdown(down)} | " + " | ".join(names) + " |"
    yield "|---" * (len(columns) + 1) + "|"
    for row in values[down]:
        found = [_square(cells.get((row, column)), squares) for column in columns]
        yield f"| {in_markdown(row)} | " + " | ".join(found) + " |"
    yield ""
    yield "  ".join(f"{square} {in_markdown(label)}" for label, square in squares.items())


def _square(labels: Counter[str] | None, squares: dict[str, str]) -> str:
    """Return the square of a cell's most frequent failure, and how many of its runs have it."""
    if not labels:
        return ""
    failures = Counter({label: n for label, n in labels.items() if label != "stable"})
    label, number = (failures or labels).most_common(1)[0]
    return squares[label] + (f" {number}/{labels.total()}" if number < labels.total() else "")


def _value(run: dict[str, Any], axis: str) -> str:
    value = run.get(axis, run.get(f"settings.{axis}"))
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _order(text: str) -> tuple[float, str]:
    try:
        return float(text), ""
    except ValueError:
        return float("inf"), text


def _failed_checks(file: Path) -> list[tuple[str, str]]:
    checks = json.loads(file.read_text(encoding="utf-8"))["findings"]
    failed = [check for check in checks if check["outcome"] == "failed"]
    return [(check["name"], f"{check['name']}: {check['message']}") for check in failed]


def _unmet(runs: Sequence[dict[str, Any]]) -> list[tuple[str, str]]:
    unmet = [run for run in runs if run["expectation_met"] is False or run["status"] != "ok"]
    reasons = (run["expectation_reason"] or run["status_reason"] or run["label"] for run in unmet)
    return [
        ("expectations still met", f"run {run['run_id'][:8]} ({run['label']}): {reason}")
        for run, reason in zip(unmet, reasons, strict=True)
    ]


def placed_annotations(sweep: str, failures: Sequence[tuple[str, str]]) -> Iterator[str]:
    """Return GitHub's annotations of failures, at the line of the sweep file that is to blame.

    What says how many more there are stands at the line of the first of these.
    """
    file = Path(sweep)
    lines = file.read_text(encoding="utf-8").splitlines() if file.is_file() else []
    keys = {"expectations still met": "expect", "tolerances still met": "tolerances"}
    shown = write_annotations("contactlab", [message for _, message in failures], []).splitlines()
    for annotation, (name, _) in zip(shown, failures, strict=False):
        place = f"file={_property(sweep)},line={_line(lines, keys.get(name, 'scene'))},"
        yield annotation.replace("::error ", f"::error {place if lines else ''}", 1)


def _line(lines: Sequence[str], key: str) -> int:
    found = (number for number, line in enumerate(lines, 1) if re.match(rf"{key}\s*:", line))
    return next(found, 1)


def _property(text: str) -> str:
    return text.replace("%", "%25").replace(":", "%3A").replace(",", "%2C")


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
