"""The GUID of an FMU of this project: it follows from the model's name and its sources.

Whoever reads an FMU finds out by it whether the FMU is what it says (`cosim_master.fmi.slaves.isolated`).
"""

from __future__ import annotations

import uuid
from collections.abc import Mapping

__all__ = ["guid_of"]

_NAMESPACE = uuid.UUID("6b1f3a52-5a0e-4b52-9a70-3f7d0c1e9a11")


def guid_of(model_name: str, digests: Mapping[str, str]) -> str:
    """Returns the GUID of a model with sources of these SHA-256 digests, by dotted name."""
    return str(uuid.uuid5(_NAMESPACE, f"{model_name}:{sorted(digests.items())}"))
