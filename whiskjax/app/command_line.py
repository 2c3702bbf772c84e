"""The verbs of `whiskjax`, put together."""

from importlib import metadata
from typing import Annotated

import typer

from .adjust import adjust
from .calibrate import calibrate
from .doctor import doctor
from .locate import locate
from .reproduce import reproduce
from .simulate import simulate

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Differentiable sensor models for airborne scanners and cameras.",
    epilog="Exit codes: 0 the result is sound, 1 bad input, 2 wrong usage, 3 there is a result but it is not sound.",
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"whiskjax {metadata.version('whiskjax')}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")] = False,
) -> None:
    pass


app.command()(calibrate)
app.command()(locate)
app.command()(adjust)
app.command()(doctor)
app.add_typer(simulate, name="simulate")
app.add_typer(reproduce, name="reproduce")
