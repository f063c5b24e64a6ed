"""The columns of the table say the same as the fields of the record."""

import pyarrow as pa
import pytest
from pydantic import BaseModel

from contactlab.schema.evidence import Accuracy, Cost, EvidenceRecord, Timing
from contactlab.store.table_layout import FIXED_COLUMNS, table_schema


@pytest.mark.parametrize(
    ("model", "prefix"), [(EvidenceRecord, ""), (Accuracy, ""), (Timing, ""), (Cost, "cost_")]
)
def test_a_field_says_the_same_in_schema_and_table(model: type[BaseModel], prefix: str) -> None:
    columns = {column.name: column for column in FIXED_COLUMNS}
    properties = model.model_json_schema(mode="serialization")["properties"]
    shared = {name for name in properties if prefix + name in columns and name != "labels"}
    assert len(shared) >= min(len(properties), 20)
    for name in shared:
        column, said = columns[prefix + name], properties[name]
        assert column.description.removesuffix(", as JSON") == said["description"], name
        assert (column.unit, column.better) == (said.get("unit", ""), said.get("better", "")), name


def test_every_number_of_a_column_states_its_unit() -> None:
    numbers = {pa.int64(), pa.float64()}
    without = [
        each.name
        for each in table_schema(())
        if each.type in numbers and not each.metadata.get(b"unit")
    ]
    assert without == []
