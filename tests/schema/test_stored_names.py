"""Names that earlier versions wrote into stores are read as the names of today."""

import json

import pytest
from tests.store.conftest import identity

from contactlab.schema.evidence import SweepIdentity
from contactlab.store.store_files import other_parts

OLD = ("--set seeds=3", "--only cone=elliptic", "--limit 2")
NEW = ("--set seeds=3", "--where cone=elliptic", "--limit 2")


def test_a_filter_has_the_name_of_today() -> None:
    """A store with `--only` in its list is the sweep that `--where` asks for, and no other."""
    stored = json.loads(identity(4).model_dump_json()) | {"overrides": OLD}
    read = SweepIdentity.model_validate_json(json.dumps(stored))
    assert read.overrides == NEW
    assert other_parts(read, identity(4, overrides=NEW)) == []
    other = {"overrides": ("--where cone=pyramidal",)}
    assert other_parts(read, identity(4, **other)) == [], "the same runs by other options"
    assert other_parts(read, identity(4, **other, plan_hash="b" * 16)) == ["options", "runs"]


@pytest.mark.parametrize("text", ["--set only=1", "--set x='--only y'"])
def test_other_options_are_unchanged(text: str) -> None:
    stored = json.loads(identity(1).model_dump_json()) | {"overrides": [text]}
    assert SweepIdentity.model_validate_json(json.dumps(stored)).overrides == (text,)
