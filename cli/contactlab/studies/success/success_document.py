"""Describes successes of episodes: as written and physical, losses, variants, the parting."""

from collections.abc import Iterator

from contactlab.judge.wording import out_of
from contactlab.rendering.amounts import format_amount, format_interval, format_percent
from contactlab.rendering.document import (
    Block,
    Column,
    Document,
    Facts,
    Headline,
    Items,
    Row,
    Section,
    Sentence,
    Table,
    document_of,
    table_of,
)
from contactlab.schema.success import SuccessReport, SuccessShare, VariantResult

_GROUPS = {
    "numerics": "must not matter",
    "control": "chance alone",
    "robot": "a robot meets them",
}


def describe_success(report: SuccessReport, *, headed: bool = True) -> Document:
    """Describe how many successes are physical, and the causes that take the others away."""
    head: list[Block] = [Headline(headline_of(report))] if headed else []
    for each in report.requirements:
        more = f"; about {each.needed:,} episodes would decide it" if each.needed else ""
        head.append(Sentence(f"{each.text}: {each.outcome}{more}"))

    loss_heads = ("takes successes away", Column("lost", "right"), Column("alone", "right"), "")
    losses = [(each.cause, each.episodes, each.alone, each.example) for each in report.losses]
    variant_heads = (
        Column("variant"),
        Column("success", "right"),
        Column("95 %", "right"),
        Column("lost", "right"),
        Column("gained", "right"),
        Column("p", "right"),
    )
    variants = tuple(map(_variant_row, report.variants))
    parting_facts = list[tuple[str, str]]()
    if parting := report.parting:
        case = ", ".join(f"{name} {value}" for name, value in parting.case.items())
        distance = format_amount(parting.distance, "mm")
        when = f"{format_amount(parting.time, 's')} ({parting.variant}; {case})"
        parting_facts.append(("parting", f"{parting.body} is {distance} apart at {when}"))
        for each in parting.forces:
            before, after = (format_amount(value, "N") for value in (each.written, each.variant))
            parting_facts.append(("", f"{each.pair}: {before} as written, {after} in the variant"))
    return document_of(
        head,
        [Facts(tuple(_share_facts(report)))],
        Section((table_of(loss_heads, losses),) if losses else (), "losses"),
        Section((Table(variant_heads, variants),) if variants else (), "variants"),
        [Facts(tuple(parting_facts))] if parting_facts else [],
        [Items(report.not_checked, "not known from these episodes:")] if report.not_checked else [],
        [Sentence(note) for note in report.notes],
    )


def headline_of(report: SuccessReport) -> str:
    """Return the result in one sentence: `95 % succeed, 60 % physically`."""
    shares = [format_percent(each.share) for each in (report.written, report.physical)]
    if not report.repeated:
        return f"{shares[0]} succeed, {shares[1]} with sound contacts"
    same = "all of them" if report.written.good else "none"
    if report.written.good == report.physical.good:
        return f"{shares[0]} succeed, {same} physically"
    return f"{shares[0]} succeed, {shares[1]} physically"


def _share_facts(report: SuccessReport) -> Iterator[tuple[str, str]]:
    yield "as written", _share_text(report.written)
    yield "sound contacts", _share_text(report.sound)
    if report.repeated:
        yield "physical", _share_text(report.physical)
    lost = report.written.good - report.physical.good
    ends = format_interval(*report.difference)
    chance_text = f"p = {report.chance:.2g}, McNemar"
    if lost and report.needed:
        chance_text = (
            f"not distinguishable from chance ({chance_text}); about {report.needed:,} episodes "
            "would be"
        )
    noun = "success" if lost == 1 else "successes"
    yield "difference", f"{lost} {noun} lost, {ends}; {chance_text}"
    if report.stop == "decided":
        yield "episodes", f"stopped at {report.written.episodes}, once decided"
    elif report.anytime:
        yield "episodes", "all; intervals hold at any number of them"
    object_source = "named" if report.named else "found in the traces"
    yield "object", f"{', '.join(report.objects)} ({object_source})"
    yield (
        "contacts",
        ", ".join(f"{each.pair} {format_percent(each.share)}" for each in report.pairs),
    )
    yield "policy", report.policy


def _share_text(share: SuccessShare) -> str:
    ends = format_interval(share.low, share.high)
    return (
        f"{out_of(share.good, share.episodes, 'episode')}, {format_percent(share.share)} ({ends})"
    )


def _variant_row(result: VariantResult) -> Row:
    share = result.success
    if share is None or result.chance is None:
        cells = ("-", "-", "-", "-", "-")
    else:
        cells = (
            format_percent(share.share),
            format_interval(share.low, share.high),
            str(result.lost),
            str(result.gained),
            f"{result.chance:.2g}",
        )
    details = (result.problem,) if result.problem else ()
    return Row((result.name, *cells), _GROUPS[result.kind], details, result.summary)
