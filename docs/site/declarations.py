"""Directives of Sphinx for pages that are made from the code: declarations of models, public names, and errors."""

from __future__ import annotations

import inspect
import math
from typing import Any

from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

import cosim_master
from cosim.build import models_of_package
from cosim.model import Model, Variable
from cosim_master.diagnostics import errors
from cosim_master.diagnostics.errors import CosimError

_PARTS = {
    "Parameters": ("parameter",),
    "Inputs": ("input", "packet input"),
    "Outputs": ("output", "packet output"),
}


class DeclaredModels(SphinxDirective):
    """A section for each model of `cosim_models`: its parameters, inputs and outputs."""

    def run(self) -> list[Any]:
        text = [_section(model) for model in models_of_package("cosim_models")]
        return self.parse_text_to_nodes("\n".join(text), allow_section_headings=True)


def _section(model: type[Model]) -> str:
    summary = inspect.cleandoc(model.__doc__ or "").split("\n\n")[0]
    text = [f"## {model.__name__}", "", summary, ""]
    for title, roles in _PARTS.items():
        if declared := [one for one in model.variables if one.role in roles]:
            text += [f"| {title} | type | unit | start | limits | |", "|---|---|---|---|---|---|"]
            text += [*map(_row, declared), ""]
    return "\n".join(text)


def _row(one: Variable) -> str:
    size = "".join(f"[{n}]" for n in one.shape)
    kind = one.enumeration.__name__ if one.enumeration else one.kind
    start = str(one.start) if one.role in ("parameter", "input") else ""
    cells = (f"`{one.name}{size}`", kind, one.unit or "", start, _limits(one), one.description)
    return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"


def _limits(one: Variable) -> str:
    if one.enumeration:
        return ", ".join(f"{int(item)} {item.name}" for item in one.enumeration)
    low, high = one.limits()
    if math.isinf(low) and math.isinf(high):
        return ""
    if math.isinf(high):
        return f"at least {low:g}"
    return f"at most {high:g}" if math.isinf(low) else f"{low:g} to {high:g}"


class PublicNames(SphinxDirective):
    """The documentation of each name of `cosim_master.__all__`, functions first."""

    def run(self) -> list[Any]:
        text = []
        for name in sorted(cosim_master.__all__, key=lambda name: (name[0].isupper(), name.lower())):
            found = getattr(cosim_master, name)
            kind = "exception" if isinstance(found, type) and issubclass(found, BaseException) else "class"
            options = ":members:" if kind == "class" else ""
            text.append(
                f"```{{eval-rst}}\n.. auto{kind if isinstance(found, type) else 'function'}:: cosim_master.{name}"
            )
            text.append(f"   {options}\n```\n" if options and isinstance(found, type) else "```\n")
        return self.parse_text_to_nodes("\n".join(text))


class Errors(SphinxDirective):
    """The tree of exceptions, and the documentation of each."""

    def run(self) -> list[Any]:
        tree = inspect.cleandoc(errors.__doc__ or "").split("\n\n")[1]
        text = [f"```text\n{inspect.cleandoc(tree)}\n```\n"]
        for found in (CosimError, *CosimError.__subclasses__()):
            text.append(f"```{{eval-rst}}\n.. autoexception:: {found.__module__}.{found.__name__}\n```\n")
        return self.parse_text_to_nodes("\n".join(text))


def setup(app: Sphinx) -> dict[str, bool]:
    """Registers the directives."""
    app.add_directive("declared-models", DeclaredModels)
    app.add_directive("public-names", PublicNames)
    app.add_directive("errors", Errors)
    return {"parallel_read_safe": True}
