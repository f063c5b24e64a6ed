"""The command `contactlab`, also as `python -m contactlab`."""

# Before all that it is about.
import contactlab.startup  # noqa: F401 # pyright: ignore[reportUnusedImport]


def main() -> None:
    """Run the command line; Ctrl-C while it loads is no error to report."""
    try:
        from contactlab.command_line.main import main as run  # noqa: PLC0415 - takes a while

        run()
    except KeyboardInterrupt:
        raise SystemExit(130) from None


if __name__ == "__main__":
    main()
