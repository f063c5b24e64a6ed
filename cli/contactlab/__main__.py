"""The command `contactlab`, also as `python -m contactlab`."""

import os
import sys

try:
    import signal  # loads a dozen more, unless Python's own start has
except KeyboardInterrupt:
    os._exit(130)


def _leave(*_: object) -> None:
    os._exit(130)


# Before all that it is about; one who has Ctrl-C ignored, or heard otherwise, keeps that.
_HEARD = signal.getsignal(signal.SIGINT) is signal.default_int_handler
if _HEARD:
    signal.signal(signal.SIGINT, _leave)

import contactlab.startup  # noqa: E402, F401 # pyright: ignore[reportUnusedImport]


def main() -> None:
    """Run the command line; Ctrl-C is no error to report."""
    from contactlab.command_line.main import main as run  # noqa: PLC0415 - takes a while
    from contactlab.command_line.terminal import interrupt  # noqa: PLC0415 - as above
    from contactlab.parts import register_parts  # noqa: PLC0415 - as above

    register_parts()
    try:
        if _HEARD:
            signal.signal(signal.SIGINT, interrupt)
        run()
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except (MemoryError, ValueError) as error:
        # MuJoCo says it in words of its own.
        if not isinstance(error, MemoryError) and "Could not allocate memory" not in str(error):
            raise
        sys.stderr.write("error: out of memory; free some, or raise its limit (ulimit -v)\n")
        raise SystemExit(2) from None
    finally:
        if _HEARD:
            signal.signal(signal.SIGINT, _leave)


if __name__ == "__main__":
    main()
