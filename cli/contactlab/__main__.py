"""The command `contactlab`, also as `python -m contactlab`."""

import os
import sys

if __name__ == "__main__" and not sys.flags.safe_path:
    # `python -m` looks into the current folder first, which may be a stranger's.
    del sys.path[0]
try:
    import signal  # loads a dozen more, unless Python's own start has
except KeyboardInterrupt:
    os._exit(130)


def _exit_process(*_: object) -> None:
    os._exit(130)


# This comes before all other work; a caller that handles Ctrl-C itself keeps its handler.
_HEARD = signal.getsignal(signal.SIGINT) is signal.default_int_handler
if _HEARD:
    signal.signal(signal.SIGINT, _exit_process)

import contactlab.startup  # noqa: E402, F401 # pyright: ignore[reportUnusedImport]


def main() -> None:
    """Run the command line; Ctrl-C is not an error to report."""
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
    finally:
        if _HEARD:
            signal.signal(signal.SIGINT, _exit_process)


if __name__ == "__main__":
    main()
