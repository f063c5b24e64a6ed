"""The help of every command and group, 100 columns wide."""

from collections.abc import Iterator

from tests.guards.records import Items

_WIDTH = 100


def help_items() -> Items:
    """Return the help of all commands of contactlab's own, in the order of the command line."""
    import typer  # noqa: PLC0415 - collection is quick without
    from typer.testing import CliRunner  # noqa: PLC0415 - as above

    from contactlab.command_line.main import command_line  # noqa: PLC0415 - as above
    from contactlab.parts import register_parts  # noqa: PLC0415 - as above

    register_parts()
    app = command_line()
    runner = CliRunner()

    def help_of(words: tuple[str, ...]) -> list[str]:
        done = runner.invoke(
            app,
            [*words, "--help"],
            prog_name="contactlab",
            terminal_width=_WIDTH,
            color=False,
            catch_exceptions=False,
        )
        assert done.exit_code == 0, done.output
        return done.stdout.splitlines()

    commands = _commands(typer.main.get_command(app))
    return {
        "command": {
            " ".join(["contactlab", *words]): {"help": help_of(words)} for words in commands
        }
    }


def _commands(command: object, words: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    yield words
    for name, inner in getattr(command, "commands", {}).items():
        if _is_ours(inner):
            yield from _commands(inner, (*words, name))


def _is_ours(command: object) -> bool:
    """Whether a command is not another installed package's; a group has no callback."""
    home = getattr(getattr(command, "callback", None), "__module__", "contactlab")
    return home.partition(".")[0].partition("_")[0] == "contactlab"
