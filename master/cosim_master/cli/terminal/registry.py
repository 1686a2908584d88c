"""The command `uav-cosim` itself, and the decorator that makes a function one of its verbs."""

from __future__ import annotations

import errno
import functools
import inspect
from collections.abc import Callable
from importlib.metadata import version
from typing import Annotated, Any, TypeVar

import typer
from typer.core import TyperCommand, TyperGroup

from cosim_master.cli.terminal.console import (
    OutputFailed,
    begin_verb,
    end_verb,
    print_json,
    report_error,
    set_verbosity,
    written,
)
from cosim_master.cli.terminal.ctrl_c import interrupts_verb

__all__ = ["app", "verb"]

F = TypeVar("F", bound=Callable[..., None])

Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="Print data and errors only.", show_default=False)]
Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="Show what FMUs log.", show_default=False)]

_UsageError: Any = typer.BadParameter.__mro__[1]  # of click, or of the copy of it that newer versions of Typer have

_ORDER = (
    *("run", "info", "view", "plot", "report", "compare", "export", "repair"),
    *("check", "explain", "graph", "new", "swap", "pack", "convert"),
    *("sweep", "serve", "build", "dialect"),
)


class _Verb(TyperCommand):
    def make_context(self, info_name: str | None, args: list[str], *arguments: Any, **further: Any) -> Any:
        begin_verb()
        as_json = "--json" in args and any("--json" in option.opts for option in self.params)
        with written():  # --help is printed while arguments are read
            try:
                return super().make_context(info_name, args, *arguments, **further)
            except _UsageError as error:
                if as_json:
                    print_json({"errors": [{"file": None, "line": None, "message": error.format_message()}]})
                raise
            except typer.Exit:  # a value is wrong
                if as_json:
                    end_verb()
                raise


class _Verbs(TyperGroup):
    """The verbs in the order in which a user meets them, each with its whole sentence."""

    def make_context(self, *arguments: Any, **further: Any) -> Any:
        with written():  # and --version
            return super().make_context(*arguments, **further)

    def list_commands(self, ctx: Any) -> list[str]:
        known = super().list_commands(ctx)
        return sorted(known, key=_ORDER.index)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(
                [(name, self.commands[name].get_short_help_str(1000)) for name in self.list_commands(ctx)]
            )


app = typer.Typer(
    cls=_Verbs,
    name="uav-cosim",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    epilog="\b\nExamples:\n  uav-cosim run line5\n  uav-cosim view out/line5\n  uav-cosim run --help",
)


def _version(asked: bool) -> None:
    if asked:
        typer.echo(f"uav-cosim {version('uav-cosim')}")
        raise typer.Exit


@app.callback()
def options(
    quiet: Quiet = False,
    verbose: Verbose = False,
    _: Annotated[
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Print the version.", show_default=False),
    ] = False,
) -> None:
    """Co-simulation of cooperating UAVs: FMUs, SSP systems, MAVLink packets over a simulated radio."""
    set_verbosity(quiet=quiet, verbose=verbose)


def verb(*examples: str) -> Callable[[F], F]:
    """Makes a function a verb of the command, with its own options -q and -v, and with examples at the end of its help.

    Ctrl-C ends a verb with exit code 130, unless the verb handles it itself.

    Args:
        examples: examples of use, without the name of the command.
    """

    def decorate(function: F) -> F:
        @functools.wraps(function)
        def call(*, quiet: bool, verbose: bool, **arguments: Any) -> None:
            set_verbosity(quiet=quiet or None, verbose=verbose or None)
            begin_verb()
            try:
                try:
                    interrupts_verb()
                    function(**arguments)
                except KeyboardInterrupt:
                    report_error("interrupted")
                    raise typer.Exit(130) from None
                except OSError as error:
                    if error.errno != errno.ENAMETOOLONG:
                        raise
                    longest = max(str(error.filename).split("/"), key=len)
                    report_error(f"{longest[:40]}...: this name is too long for a file")
                    raise typer.Exit(2) from None
                finally:
                    if arguments.get("as_json"):
                        end_verb()
            except OutputFailed as error:
                report_error(str(error))
                raise typer.Exit(1) from None

        own = inspect.signature(function, eval_str=True)
        switches = [
            inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=annotation)
            for name, annotation in (("quiet", Quiet), ("verbose", Verbose))
        ]
        call.__signature__ = own.replace(parameters=[*own.parameters.values(), *switches])  # type: ignore[attr-defined]
        call.__annotations__ = {p.name: p.annotation for p in call.__signature__.parameters.values()}  # type: ignore[attr-defined]
        shown = "".join(f"\n  uav-cosim {example}" for example in examples)
        app.command(cls=_Verb, epilog=f"\b\nExample{'s' if len(examples) > 1 else ''}:{shown}")(call)
        return function

    return decorate
