"""The commands `engines`: what can simulate here, and how to get more."""

import typer

from contactlab.commands import options as opt
from contactlab.commands.terminal import echo, print_rows, say

engines = typer.Typer(help="Engines that can simulate.", invoke_without_command=True)


@engines.callback()
def list_engines(context: typer.Context, output: opt.Format = opt.FORMAT) -> None:
    """List the engines: what each is, and the version that is installed."""
    if context.invoked_subcommand is not None:
        return
    from contactlab.engines import ENGINES

    rows = [(each.name, each.version or "not installed", each.summary) for each in ENGINES.values()]
    print_rows(output, ("engine", "version", "what computes"), rows)
    say("more by `contactlab engines add NAME`")


@engines.command()
def add(name: str = typer.Argument(help="Engine to install.")) -> None:
    """Install an engine in an environment of its own, in the user's cache."""
    from contactlab.engines import find_engine
    from contactlab.engines.adapted_engine import AdaptedEngine
    from contactlab.run.mujoco_environment import make_environment

    engine = find_engine(name)
    if not isinstance(engine, AdaptedEngine) or engine.version:
        echo(f"{name} {engine.version} is here")
        return
    say(f"setting up {name} in {engine.environment}, once")
    advice = f"look whether this machine can have {' and '.join(engine.requirements)}"
    make_environment(engine.environment, engine.requirements, name, advice, lambda _: None)
    echo(f"{name} {engine.version}")
