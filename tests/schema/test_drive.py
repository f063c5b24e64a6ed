"""A drive reads the same from data and from its short form, and mistakes are located."""

from typing import Any

import pytest
from pydantic import TypeAdapter, ValidationError

from contactlab.schema.drive import (
    Drive,
    FileDrive,
    drive_identity,
    drive_text,
    read_drive,
)

ADAPTER: TypeAdapter[Drive] = TypeAdapter(Drive)
FORMS: dict[str, Any] = {
    "auto": "auto",
    "none": "none",
    "hold": "hold",
    "exercise": "exercise",
    "noise=0.3": {"noise": 0.3},
    "noise=0.3,rate=4": {"noise": 0.3, "rate": 4},
    "runs/controls.csv": {"file": "runs/controls.csv"},
    "file=controls.npz,interpolation=hold": {"file": "controls.npz", "interpolation": "hold"},
    "balance.py:Balance": {"policy": "balance.py:Balance"},
    "kp=40,kd=1,rate=500": {"kp": 40, "kd": 1, "rate": 500},
    "policy=p.py:P,rate=20,latency=0.01,noise.qvel=0.1": {
        "policy": "p.py:P",
        "rate": 20,
        "latency": 0.01,
        "noise": {"qvel": 0.1},
    },
}


@pytest.mark.parametrize("text", FORMS)
def test_short_form_data_and_canonical_form_agree(text: str) -> None:
    drive = ADAPTER.validate_python(FORMS[text])
    assert read_drive(text) == drive
    assert read_drive(drive_text(drive)) == drive
    assert ADAPTER.validate_json(ADAPTER.dump_json(drive)) == drive


BAD: list[Any] = [
    *("holds", {}, 3, None, {"file": ""}, {"noise": 0.1, "file": "x"}),
    *({"noise": 0}, {"noise": 1.5}, {"noise": 0.1, "rate": 0}),
    *({"policy": "p.py"}, {"policy": "p.py:P", "latency": -1.0}),
]


@pytest.mark.parametrize("data", BAD)
def test_others_are_refused(data: object) -> None:
    with pytest.raises(ValidationError):
        ADAPTER.validate_python(data)


def test_identity_knows_a_file_by_its_hash_not_its_place() -> None:
    here, there = (FileDrive(file=f"{folder}/x.csv", sha256="0" * 64) for folder in ("a", "b"))
    assert drive_identity(here) == drive_identity(there) != drive_identity(read_drive("x.csv"))
    assert drive_identity(read_drive("none")) is None
