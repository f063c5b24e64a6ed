"""Reads advisories: those of contactlab, of installed packages, and files that a user names."""

from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from hashlib import sha256
from pathlib import Path
from types import ModuleType

from pydantic import ValidationError

from contactlab import resources
from contactlab.advisories.field_expressions import FieldExpression
from contactlab.errors import AdvisoryError, SceneError, did_you_mean, no_file, refuse_pipe
from contactlab.expression import ExpressionError
from contactlab.plugins import find_extensions
from contactlab.schema.advisory import Advisory
from contactlab.schema.strict_model import check_extent

ENTRY_POINTS = "advisory_folder"
"""Kind of the extensions that name folders of advisories: a path or a package each."""


@cache
def list_advisories() -> tuple[Advisory, ...]:
    """Return the advisories of contactlab and of installed packages, by id.

    Raises:
        AdvisoryError: a file is wrong, or two advisories have one id.
    """
    folders = (extension.load() for extension in find_extensions(ENTRY_POINTS).values())
    files = [
        file
        for folder in folders
        for path in (folder.__path__ if isinstance(folder, ModuleType) else [folder])
        for file in sorted(Path(path).glob("*.yaml"))
    ]
    return read_advisories(files)


def read_advisories(files: Iterable[Path]) -> tuple[Advisory, ...]:
    """Return the advisories of some files, by id.

    Raises:
        AdvisoryError: a file is wrong, or two advisories have one id.
    """
    by_id = dict[str, Advisory]()
    for file in files:
        advisory = read_advisory(file)
        if advisory.id in by_id:
            raise AdvisoryError(f"{file}: there is another {advisory.id}; give it the next number")
        by_id[advisory.id] = advisory
    return tuple(by_id[name] for name in sorted(by_id))


def read_advisory(file: Path) -> Advisory:
    """Return the advisory of a file, from the index if it is shipped.

    Raises:
        AdvisoryError: the file has these mistakes.
    """
    try:
        refuse_pipe(file)
        digest = sha256(file.read_bytes()).hexdigest()
    except OSError:
        return parse_advisory(file)  # which says why
    indexed = _read_index().get(digest)
    return parse_advisory(file) if indexed is None else Advisory.model_validate(indexed)


_read_index = cache(resources.advisory_index)


def parse_advisory(file: Path) -> Advisory:
    """Return the advisory of a file; an AdvisoryError lists its mistakes."""
    from ruamel.yaml import YAML  # noqa: PLC0415 - shipped advisories are parsed already
    from ruamel.yaml.error import YAMLError  # noqa: PLC0415

    try:
        refuse_pipe(file)
        text = file.read_text(encoding="utf-8")
        check_extent(text)
        advisory = Advisory.model_validate(YAML(typ="safe", pure=True).load(text))
    except (FileNotFoundError, IsADirectoryError) as error:
        raise AdvisoryError(no_file(file, "advisory", {".yaml"})) from error
    except ValidationError as error:
        lines = (
            f"{file}: {'.'.join(map(str, entry['loc']))}: {entry['msg']}"
            for entry in error.errors()
        )
        raise AdvisoryError("\n".join(lines)) from error
    except OSError as error:
        raise AdvisoryError(f"cannot read {file}: {error.strerror}; name a file") from error
    except (YAMLError, ValueError) as error:
        raise AdvisoryError(f"{file}: not YAML: {error}") from error
    if mistakes := [*_find_mistakes(advisory)]:
        raise AdvisoryError("\n".join(f"{file}: {mistake}" for mistake in mistakes))
    return advisory


def _find_mistakes(advisory: Advisory) -> Iterator[str]:
    # Types do not check expressions, names of modifications and distances of values.
    from contactlab.modifications.catalogue import CATALOGUE  # noqa: PLC0415 - takes a while
    from contactlab.scene.model_xml import parse_text  # noqa: PLC0415 - as above

    witness = advisory.witness
    expressions = {"applies": advisory.applies, "witness.measure": witness.measure}
    if advisory.occurs:
        expressions["occurs"] = advisory.occurs
    for key, text in expressions.items():
        try:
            FieldExpression(text)
        except ExpressionError as error:
            yield f"{key}: {error}: {text}"
    try:
        parse_text(witness.model, "witness.model")
    except SceneError as error:
        yield str(error)
    if abs(witness.wrong - witness.right) <= 2 * witness.tolerance:
        yield (
            f"witness: right {witness.right:g} and wrong {witness.wrong:g} are within twice the "
            f"tolerance {witness.tolerance:g}; measure something that differs more"
        )
    if not (advisory.workarounds or advisory.advice):
        yield "workarounds: name a modification, or write advice"
    for workaround in advisory.workarounds:
        name = workaround.modification
        if name not in CATALOGUE:
            hint = did_you_mean(name, CATALOGUE) or "; docs/reference/modifications.md lists them"
            yield f"workarounds: there is no modification '{name}'{hint}"
            continue
        edits: Sequence[str] = CATALOGUE[name].edits
        for setting in workaround.settings:
            if setting.partition("[")[0] not in edits:
                yield (f"workarounds: '{name}' does not set {setting}; it sets {', '.join(edits)}")
