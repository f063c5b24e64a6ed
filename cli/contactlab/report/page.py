"""The page: everything of a store in one file that needs nothing else."""

from importlib import resources
from typing import TYPE_CHECKING, Any

from contactlab.report.asking import PageAsk
from contactlab.report.changes import changes
from contactlab.report.charts import default_map, label_bar, pictured
from contactlab.report.content import Content, content
from contactlab.report.drawing import bundle
from contactlab.report.facts import expectations, facts, missed, verdict
from contactlab.report.gathering import Gathered, gather
from contactlab.report.packing import as_json, packed_text
from contactlab.report.scatter import tradeoff_chart
from contactlab.report.tables import change_table, front_table, label_table, map_table, recommended
from contactlab.report.versus import Versus, versus
from contactlab.store import Store

if TYPE_CHECKING:
    from jinja2 import Environment

_SCRIPTS = ("data", "state", "table", "heatmap", "weighing", "run", "main")


def page(store: Store, ask: PageAsk) -> tuple[str, tuple[str, ...]]:
    """Return the page of a store, and notes on what it leaves out."""
    gathered = gather(store, ask.question)
    chart = tradeoff_chart(gathered)
    given = content(gathered, ask, chart)
    beside = versus(gathered, ask.baseline) if ask.baseline else None
    text = _page(gathered, given, chart, beside)
    return text, given.notes


def _page(
    gathered: Gathered, given: Content, chart: dict[str, Any] | None, beside: Versus | None
) -> str:
    return (
        _environment()
        .get_template("page.html")
        .render(
            **_texts(gathered),
            **_pictures(gathered, chart),
            style=_read("style.css"),
            script="\n".join(_read(f"script/{name}.js") for name in _SCRIPTS),
            bundle=packed_text(bundle()),
            words=packed_text(as_json(given.words)),
            columns=as_json(given.columns),
            series=as_json(given.series),
            left_out=given.notes,
            versus=beside,
            versus_maps=_versus_maps(beside),
        )
    )


def _texts(gathered: Gathered) -> dict[str, Any]:
    store = gathered.store
    manifest = store.manifest
    outcome, told = verdict(manifest)
    return {
        "title": f"{manifest.sweep.name}: {manifest.sweep.scene}",
        "description": manifest.sweep.resolved.get("description") or "",
        "store": str(store.address),
        "runs": manifest.runs,
        "facts": facts(store),
        "outcome": outcome,
        "verdict": told,
        "labels": label_table(gathered.outcomes),
        "recommended": recommended(gathered),
        "unweighed": gathered.unweighed,
        "front": front_table(gathered),
        "map": map_table(gathered),
        "boundary": gathered.boundary.told if gathered.boundary else "",
        "changes": change_table(
            gathered, changes(gathered.axes, gathered.outcomes, gathered.quantities)
        ),
        "expectations": expectations(store),
        "missed": missed(store),
    }


def _pictures(gathered: Gathered, chart: dict[str, Any] | None) -> dict[str, str]:
    plane = gathered.plane
    over = " and ".join(axis.name for axis in (plane.x, plane.y) if axis) if plane else ""
    return {
        "bar": pictured(label_bar(gathered.outcomes), "All runs, split by label"),
        "heatmap": pictured(default_map(gathered), f"Labels over {over}"),
        "chart": pictured(chart, "Error against time of each configuration"),
    }


def _versus_maps(beside: Versus | None) -> list[str]:
    maps = beside.maps.items() if beside else ()
    return [pictured(spec, f"{name}: baseline, candidate and difference") for name, spec in maps]


def _environment() -> "Environment":
    from jinja2 import Environment, PackageLoader, StrictUndefined  # noqa: PLC0415 - an extra

    return Environment(
        loader=PackageLoader("contactlab.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def _read(name: str) -> str:
    return resources.files("contactlab.report").joinpath(name).read_text(encoding="utf-8")
