"""`contactlab grip`: whether a gripper holds an object."""

from pathlib import Path
from tempfile import TemporaryFile
from typing import TYPE_CHECKING, Annotated

from contactlab.command_line.declaration import Argument, Option, command, flag
from contactlab.command_line.report_formats import report_formats
from contactlab.command_line.surroundings import say
from contactlab.errors import OutputError

if TYPE_CHECKING:
    from contactlab.schema.grip import GripReport


@command(
    "examine",
    keeps="nothing",
    examples=(
        "grip gripper.xml",
        "grip robot.xml --object cylinder:30x60mm,.2kg --film grip.mp4",
        "grip scene.xml --keyframe held",
    ),
    codes="0 holds, 1 creeps or drops, 2 bad input, 130 interrupted",
    formats=report_formats(),
)
def grip(
    model: Annotated[
        str | Path,
        Argument("MODEL", "Scene, scene folder, .xml or .urdf file, or menagerie:ROBOT.", kind=str),
    ],
    *,
    object: Annotated[
        str | None,
        Option(
            "OBJECT",
            "box:30x40x40mm,.1kg, cylinder:30x60mm,.1kg, mesh:FILE,.1kg, or a body of the model.",
        ),
    ] = None,
    keyframe: Annotated[
        str | None,
        Option("KEYFRAME", "Judge the object that is held in this keyframe, as it is."),
    ] = None,
    squeeze: Annotated[
        float | None,
        Option("N", "Force of a finger [N]; default: the force at the end of the control range."),
    ] = None,
    base: Annotated[
        str | None, Option("BODY", "Body that carries the fingers; found automatically.")
    ] = None,
    tolerance: Annotated[
        float | str, Option("SPEED", "Speed above which the object creeps: 0.1mm/s.", kind=str)
    ] = "0.1mm/s",
    fixes: Annotated[bool, flag("Test fixes by running the grip with them.")] = True,
    film: Annotated[
        str | Path | None, Option("FILE", "Film of the grip: .mp4 or .gif.", kind=Path)
    ] = None,
    output: Annotated[
        str | Path | None,
        Option("FILE", "File for the report: .json.", kind=Path, short="-o"),
    ] = None,
) -> "GripReport":
    """Test whether a gripper holds, creeps or drops, and why.

    Fingers and closing controls are found by driving each actuator. The hand closes on the object
    by its own actuators. Then the weight pulls in six directions, and the object is shaken, turned
    and pulled. Fixes are tested in the same way, and timed.

    Raises:
        SceneError: there is no such model, keyframe or body; nothing closes, or nothing is held.
        SweepFileError: the speed is not a speed, or the actuators cannot give the squeeze.
        OutputError: the report or the film cannot be written.
    """
    from contactlab.store.atomic_files import atomic_write, write_errors
    from contactlab.studies.grip.gripped_object import read_speed
    from contactlab.studies.grip.gripping import GripRequest
    from contactlab.studies.verification.verified_grip import judge_verified_grip

    write_film = None
    if film is not None:
        from contactlab.studies.grip.grip_film import film_writer

        write_film = film_writer(Path(film))
    if output is not None:
        # Check that the file can be written before seconds of measuring.
        with write_errors(Path(output)), TemporaryFile(dir=Path(output).parent):
            if Path(output).is_dir():
                raise OutputError(f"{output} is a folder; write the name of a file, such as a.json")
    request = GripRequest(
        model=str(model),
        held_body=object,
        keyframe=keyframe,
        squeeze=squeeze,
        base=base,
        tolerance=read_speed(tolerance),
        fixes=fixes,
        notify=say,
        film=write_film,
    )
    report = judge_verified_grip(request)
    if film is not None:
        say(f"wrote {film}")
    if output is not None:
        with write_errors(Path(output)), atomic_write(Path(output)) as path:
            path.write_text(report.model_dump_json(indent=2) + "\n", encoding="utf-8")
        say(f"wrote {output}")
    return report
