"""The error of a study that cannot be carried out."""

from __future__ import annotations

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where

__all__ = ["refusal"]


def refusal(subject: str, text: str) -> SystemDescriptionError:
    """Returns the error about a part of a study ("--vary x=1") or its folder; the text ends with a remedy."""
    return SystemDescriptionError([Problem(Where(subject), text)])
