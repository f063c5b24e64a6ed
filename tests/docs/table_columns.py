"""Write the list of columns in docs/reference/evidence.md."""

from pathlib import Path

import pyarrow as pa

from contactlab.store.table_layout import FIXED_COLUMNS, LOOP_COLUMNS, PLUGINS_COLUMN

PAGE = Path(__file__).parents[2] / "docs/reference/evidence.md"
_BEGIN, _END = "<!-- columns: written by make schemas -->\n", "<!-- end of columns -->\n"


def column_list() -> str:
    """Return the Markdown table of all columns that the record's fields have."""
    rows = [
        f"| `{column.name}` | {_type_text(column.type)} | {column.unit} | {column.description} |\n"
        for column in (*FIXED_COLUMNS, PLUGINS_COLUMN, *LOOP_COLUMNS)
    ]
    return "".join(["| column | type | unit | value |\n|---|---|---|---|\n", *rows])


def _type_text(kind: pa.DataType) -> str:
    if pa.types.is_list(kind):
        return f"list of {_type_text(kind.value_type)}"
    return "struct" if pa.types.is_struct(kind) else str(kind)


def page_with_columns(text: str) -> str:
    """Return the text of the page with the columns as they are now."""
    head, _, rest = text.partition(_BEGIN)
    _, _, tail = rest.partition(_END)
    return f"{head}{_BEGIN}\n{column_list()}\n{_END}{tail}"


if __name__ == "__main__":
    PAGE.write_text(page_with_columns(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
