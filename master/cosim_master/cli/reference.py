"""Writes the tables of docs/command-line.md: every verb with its arguments, options, defaults and examples.

`python -m cosim_master.cli.reference docs/command-line.md` writes them below the heading of their section.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import typer.main

from cosim_master.cli import app

__all__ = ["HEADING", "tables"]

HEADING = "## Verbs and options"


def tables() -> str:
    """Returns the section on all verbs, in Markdown."""
    commands: dict[str, Any] = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    lines = [
        HEADING,
        "",
        "Written by `python -m cosim_master.cli.reference docs/command-line.md`; a test compares it with the command.",
        "Each verb also has `-q`, `-v` and `--help`.",
    ]
    for name, command in sorted(commands.items()):
        lines += ["", *_verb(name, command)]
    return "\n".join(lines) + "\n"


def _verb(name: str, command: Any) -> Iterator[str]:
    shown = [
        p for p in command.params if p.name not in ("quiet", "verbose", "help") and not getattr(p, "hidden", False)
    ]
    arguments = " ".join(_argument(p) for p in shown if p.param_type_name == "argument")
    yield f"### {name}"
    yield ""
    yield f"`{f'uav-cosim {name} {arguments}'.strip()}`: {command.help.strip().splitlines()[0]}"
    yield ""
    yield "| | | default |"
    yield "|---|---|---|"
    for p in shown:
        is_option = p.param_type_name == "option"
        words = ", ".join(f"`{word}`" for word in (*p.opts, *p.secondary_opts)) if is_option else f"`{_argument(p)}`"
        if is_option and p.metavar:
            words += f" `{p.metavar}`"
        cells = (words, p.help, _default(p))
        yield "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"
    yield ""
    yield "```"
    yield from (line.strip() for line in command.epilog.splitlines()[2:])
    yield "```"


def _argument(p: Any) -> str:
    word = str(p.metavar or p.name.upper())
    word = f"{word} ..." if p.nargs == -1 else word
    return word if p.required else f"[{word}]"


def _default(p: Any) -> str:
    if p.required:
        return "must be given"
    if isinstance(p.show_default, str):
        return p.show_default
    if p.default is None or isinstance(p.default, bool) or p.default == [] or p.show_default is False:
        return ""
    return f"`{p.default}`"


def _write(file: Path) -> None:
    """Replaces the section in a document."""
    text = file.read_text(encoding="utf-8")
    file.write_text(text[: text.index(HEADING)] + tables(), encoding="utf-8")


if __name__ == "__main__":
    _write(Path(sys.argv[1]))
