"""Rates and delays of a controller may have units, like all other quantities."""

import pytest
from pydantic import TypeAdapter, ValidationError

from contactlab.schema.drive import Drive, NoiseDrive, PdDrive

DRIVE = TypeAdapter[Drive](Drive)


@pytest.mark.parametrize("rate", [250, "250 Hz", "0.25kHz"])
@pytest.mark.parametrize("latency", [0.002, "2 ms", "50%"])
def test_a_rate_and_a_delay_mean_the_same_in_any_unit(
    rate: float | str, latency: float | str
) -> None:
    """Half a period of 250 Hz is 2 ms."""
    drive = DRIVE.validate_python({"kp": 1, "rate": rate, "latency": latency})
    assert isinstance(drive, PdDrive)
    assert drive.rate == 250
    assert drive.latency_seconds == 0.002


def test_a_rate_is_no_time_and_a_delay_no_rate() -> None:
    noise = DRIVE.validate_python({"noise": 0.3, "rate": "20 Hz"})
    assert isinstance(noise, NoiseDrive)
    assert noise.rate == 20
    for wrong in ({"rate": "2 ms"}, {"latency": "250 Hz"}):
        with pytest.raises(ValidationError):
            DRIVE.validate_python({"kp": 1, **wrong})
