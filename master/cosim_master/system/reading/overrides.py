"""Settings of radio, recording and master that a run overrides: `network.loss`, `recording.interval`, `master.nan`.

Their names consist of the tag of the annotation's element and an attribute of the annotations org.uav-cosim.network,
org.uav-cosim.recording and org.uav-cosim.master. An element of the root system with the name of the tag takes
precedence: names that begin with it are then variables, and only the annotation can set these.
"""

from __future__ import annotations

from collections.abc import Mapping

from cosim_master.system.structure import SystemStructure

__all__ = ["SETTINGS", "apart", "hidden"]

SETTINGS = ("network", "recording", "master")


def apart(overrides: Mapping[str, str], structure: SystemStructure) -> tuple[dict[str, str], dict[str, dict[str, str]]]:
    """Returns the overrides of variables, and those of settings as texts by tag and attribute."""
    tags = set(SETTINGS) - hidden(structure)
    variables: dict[str, str] = {}
    settings: dict[str, dict[str, str]] = {}
    for name, text in overrides.items():
        tag, dot, attribute = name.partition(".")
        if dot and tag in tags:
            settings.setdefault(tag, {})[attribute] = text
        else:
            variables[name] = text
    return variables, settings


def hidden(structure: SystemStructure) -> set[str]:
    """Returns the settings that a run cannot override, since an element of the root system has their name."""
    return set(SETTINGS) & {element.name for element in structure.system.elements}
