"""Rows that a command lists: data in Python, a table on the terminal."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from contactlab.command_line.declaration import Arguments, Show
from contactlab.command_line.terminal import print_csv, print_json, print_table


@dataclass(frozen=True)
class Listing(Sequence[Mapping[str, object]]):
    """Rows by column; each is a mapping from the columns to its values."""

    columns: Sequence[str]
    rows: Sequence[Sequence[object]]
    units: Mapping[str, str] = field(default_factory=dict[str, str])  # of columns

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.rows)

    def __getitem__(self, index: int) -> Mapping[str, object]:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return a row by column."""
        return dict(zip(self.columns, self.rows[index], strict=True))

    def __iter__(self) -> Iterator[Mapping[str, object]]:
        """Yield rows by column."""
        return map(self.__getitem__, range(len(self)))

    def _repr_html_(self) -> str:
        """Return the table that a notebook shows."""
        rows = "".join(_html_row("td", row) for row in self.rows)
        return f"<table>{_html_row('th', self.columns)}{rows}</table>"

    @property
    def header(self) -> list[str]:
        """The columns with their units."""
        return [
            f"{name} [{self.units[name]}]" if name in self.units else name for name in self.columns
        ]


def _html_row(tag: str, cells: Sequence[object]) -> str:
    from html import escape

    return f"<tr>{''.join(f'<{tag}>{escape(str(cell))}</{tag}>' for cell in cells)}</tr>"


def _print_text(listing: Listing, arguments: Arguments) -> None:
    del arguments
    print_table(listing.header, listing.rows)


def _print_json(listing: Listing, arguments: Arguments) -> None:
    del arguments
    print_json(list(listing))


def _print_csv(listing: Listing, arguments: Arguments) -> None:
    del arguments
    print_csv(listing.header, listing.rows)


LISTED: Mapping[str, Show] = {"text": _print_text, "json": _print_json, "csv": _print_csv}
"""Printers of a listing, by format."""
