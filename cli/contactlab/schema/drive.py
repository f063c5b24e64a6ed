"""Drives of a run: a keyframe's controls, a hold, noise, an exercise, a file, or a policy.

`auto` is the controls of the model's keyframe if it has any (with `none`), otherwise an exercise.
"""

import re
from collections.abc import Mapping
from contextlib import suppress
from typing import Annotated, Any, ClassVar, Literal, cast

from pydantic import (
    AfterValidator,
    BeforeValidator,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    TypeAdapter,
)
from pydantic_core import PydanticCustomError

from contactlab.numerical_tolerance import COARSE_ROUNDING
from contactlab.schema.setting_values import parse_decimal
from contactlab.schema.strict_model import (
    Hertz,
    Model,
    Number,
    Positive,
    Word,
    about,
    list_word,
    measured_in,
)

DRIVE_WORDS = ("auto", "none", "hold", "exercise")
"""Drives that a word names."""
DRIVE_TAKES = (
    "auto, none, hold, exercise, {noise: SHARE, rate: HZ}, {file: FILE}, {policy: FILE.py:CLASS} "
    "or {kp: GAIN, kd: GAIN}"
)
"""The forms of a drive, in words."""
_CLASS = r"^.+\.py:[A-Za-z_]\w*$"
Share = Annotated[str, Field(pattern=r"^[0-9]*\.?[0-9]+%$")]
FileHash = Annotated[
    Word | None, Field(description="SHA-256 that the file must have; records and stores state it.")
]


def _checked_class(text: str) -> str:
    if not re.match(_CLASS, text):
        raise PydanticCustomError("policy_class", "takes FILE.py:CLASS")
    return text


class NoiseDrive(Model):
    """Band-limited random controls around those at the start."""

    noise: Annotated[float, Field(strict=True, gt=0, le=1)] = about(
        "root mean square over half the range of each control"
    )
    rate: Hertz = about("highest frequency [Hz]", default=10.0)


class FileDrive(Model):
    """Controls, forces and poses over time, from a table."""

    file: Word = about(
        "a .csv, .parquet, .npz or .mcap file, next to the file that names it; columns "
        "`time` [s] and actuators, joints or bodies"
    )
    interpolation: Literal["linear", "hold"] = about(
        "between rows: linear, or each row held until the next", default="linear"
    )
    sha256: FileHash = None


class ObservationNoise(Model):
    """Standard deviations of the noise of a policy's observations."""

    qpos: Annotated[Number, Field(ge=0)] = about("m or rad", default=0.0)
    qvel: Annotated[Number, Field(ge=0)] = about("m/s or rad/s", default=0.0)


class PolicyDrive(Model):
    """Controls in closed loop, by a class of Python."""

    # The controller in words, and whether it runs code of the user.
    noun: ClassVar[str] = "policy"
    runs_code: ClassVar[bool] = True

    policy: Annotated[Word, AfterValidator(_checked_class)] = about(
        "FILE.py:CLASS, the file next to the one that names it",
        json_schema_extra={"pattern": _CLASS},
    )
    rate: Hertz = about("how often it acts [Hz], or 250 Hz", default=50.0)
    latency: Annotated[
        Annotated[Number, Field(ge=0), measured_in("s"), Tag("@seconds")]
        | Annotated[Share, Tag("@share")],
        Discriminator(lambda data: "@share" if str(data).endswith("%") else "@seconds"),
    ] = about("from observation to action: s, 8 ms, or 50% of a period", default=0.0)
    noise: ObservationNoise = about(
        "of its observations; by the run's seed", default=ObservationNoise()
    )
    files: Annotated[tuple[Word, ...], BeforeValidator(list_word)] = about(
        "files that it reads, such as its weights, next to it", default=()
    )
    sha256: FileHash = None
    send: Literal["targets"] | None = about(
        "targets: a PD sends targets to position servos of the model, which have its gains; "
        "otherwise it sends torques",
        default=None,
        exclude_if=lambda sent: sent is None,
    )

    @property
    def latency_seconds(self) -> float:
        """Time from observation to action [s]."""
        if isinstance(self.latency, str):
            return parse_decimal(self.latency.removesuffix("%")) / 100 / self.rate
        return self.latency


class PdDrive(PolicyDrive):
    """A PD controller outside of the model, which holds the start by the torques of motors."""

    noun: ClassVar[str] = "PD controller"
    runs_code: ClassVar[bool] = False

    policy: Literal["pd"] = about(  # pyright: ignore[reportIncompatibleVariableOverride]
        "always pd: the controller of contactlab", default="pd"
    )
    kp: Positive = about("gain of positions [N/m or Nm/rad]")
    kd: Annotated[Number, Field(ge=0)] = about("gain of velocities", default=0.0)


DRIVE_FORMS: Mapping[str, type[Model]] = {
    "kp": PdDrive,
    "policy": PolicyDrive,
    "file": FileDrive,
    "noise": NoiseDrive,
}


def _drive_form(data: object) -> str | None:
    if isinstance(data, str):
        return "@word" if data in DRIVE_WORDS else None
    keys = dict(data) if isinstance(data, Model) else data
    given_keys = cast("Mapping[str, object]", keys) if isinstance(keys, Mapping) else {}
    return next((f"@{name}" for name in DRIVE_FORMS if name in given_keys), None)


# Tags start with @ so that an error's path never mistakes one for a key of the file.
Drive = Annotated[
    Annotated[Literal["auto", "none", "hold", "exercise"], Tag("@word")]
    | Annotated[NoiseDrive, Tag("@noise")]
    | Annotated[FileDrive, Tag("@file")]
    | Annotated[PolicyDrive, Tag("@policy")]
    | Annotated[PdDrive, Tag("@kp")],
    Discriminator(
        _drive_form,
        custom_error_type="drive_form",
        custom_error_message=f"takes {DRIVE_TAKES}",
    ),
]
_ADAPTER: TypeAdapter[Drive] = TypeAdapter(Drive, config=ConfigDict(defer_build=True))


def read_drive(text: str) -> Drive:
    """Return the drive of a short form: a word, `noise=0.3,rate=10`, or a path.

    Other text is a ValidationError.
    """
    if ".py:" in text and "=" not in text:
        return parse_drive({"policy": text})
    if "=" not in text:
        return parse_drive({"file": text} if "." in text else text)
    data: dict[str, Any] = {}
    for part in text.split(","):
        *above, name = part.partition("=")[0].strip().split(".")
        below = data
        for key in above:
            below = below.setdefault(key, {})
        below[name] = value_text = part.partition("=")[2].strip()
        with suppress(ValueError):
            below[name] = parse_decimal(value_text)
    return parse_drive(data)


def parse_drive(data: object) -> Drive:
    """Return the drive that JSON data states; other data is a ValidationError."""
    return _ADAPTER.validate_python(data)


def drive_data(drive: Drive) -> object:
    """Return a drive as a sweep file has it."""
    return drive if isinstance(drive, str) else drive.model_dump(exclude_none=True)


def drive_word(drive: Drive) -> str | None:
    """Return the word that names a drive; None for one that has numbers or files."""
    return drive if isinstance(drive, str) else None


def drive_files(drive: Drive) -> tuple[str, ...]:
    """Return all files that a drive names, the one that drives first."""
    match drive:
        case FileDrive(file=file):
            return (file,)
        case PdDrive():
            return ()
        case PolicyDrive(policy=policy, files=files):
            return (policy.rpartition(":")[0], *files)
        case _:
            return ()


def acts_too_often(rate: float, timestep: float) -> bool:
    """Return whether a policy at this rate [Hz] acts more than once in a step [s]."""
    return rate * timestep > 1 + COARSE_ROUNDING


def drive_identity(drive: Drive) -> object:
    """Return the part of a drive that belongs to the identity of a run; None without a drive.

    The file is known by its hash: where it lies does not matter.
    """
    match drive:
        case str():
            return None if drive == "none" else drive
        case NoiseDrive():
            return drive.model_dump()
        case FileDrive():
            return drive.model_dump(exclude={"file"})
        case PolicyDrive():
            _, _, name = drive.policy.rpartition(":")
            timing = {"latency": drive.latency_seconds, "starts": "off rest"}
            return {**drive.model_dump(), "policy": name, **timing}


def describe_drive(drive: Drive) -> str:
    """Describe the drive of a run in words."""
    match drive:
        case "exercise":
            return (
                "after a rest, sines at any actuators and pushes on any free bodies (`drive: "
                "exercise`; `drive: none` leaves them out)"
            )
        case "hold":
            return "an external load holds its joints (`drive: hold`)"
        case "none":
            return "nothing but the controls of its start (`drive: none`)"
        case _:
            return drive_text(drive)


def drive_text(drive: Drive) -> str:
    """Return a drive in its short form."""
    match drive:
        case str():
            return drive
        case NoiseDrive():
            return f"noise={drive.noise:g},rate={drive.rate:g}"
        case FileDrive(file=file, interpolation=interpolation):
            return file if interpolation == "linear" else f"file={file},interpolation=hold"
        case PolicyDrive():
            noise = drive.noise
            parts = [f"policy={drive.policy}", f"rate={drive.rate:g}"]
            if isinstance(drive, PdDrive):
                parts[0] = f"kp={drive.kp:g},kd={drive.kd:g}"
            parts += [f"latency={drive.latency}"] * bool(drive.latency)
            parts += [f"noise.qpos={noise.qpos:g}"] * bool(noise.qpos)
            parts += [f"noise.qvel={noise.qvel:g}"] * bool(noise.qvel)
            parts += [f"send={drive.send}"] * bool(drive.send)
            return ",".join(parts)
