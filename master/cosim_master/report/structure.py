"""The structure of a recorded system as SVG, from its manifest: the FMUs of a drone, and the radio between the drones.

Parts of the system that contain the same FMUs are drawn once, with their number.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lxml import etree

from cosim_master.system.flatten.flat import natural

__all__ = ["Group", "draw_structure", "groups"]

_SVG = "http://www.w3.org/2000/svg"
_LETTER, _LINE, _PAD, _GAP, _LANE = 6.4, 17.0, 10.0, 26.0, 96.0
_MOST = 12
"""Groups drawn; systems of many different parts have a line of text about the others."""
_STYLE = (
    "text{font:11px sans-serif;fill:#222}.name{font-weight:bold}.light{fill:#666}"
    ".group{fill:#f7f7f2;stroke:#888}.fmu{fill:#fff;stroke:#333}.radio{fill:#e8f0f8;stroke:#0072B2}"
    ".link{stroke:#0072B2;stroke-dasharray:4 3;fill:none}"
)


@dataclass(frozen=True, slots=True)
class Group:
    """Parts of a system that contain the same FMUs.

    Attributes:
        places: names of the systems, in natural order; "" for instances of the root.
        members: name of the instance within the system, file name of its FMU, step size in s.
    """

    places: tuple[str, ...]
    members: tuple[tuple[str, str, float], ...]

    @property
    def title(self) -> str:
        """The names, shortened if there are more than two, and their number."""
        if len(self.places) < 3:
            return ", ".join(place or "system" for place in self.places)
        return f"{self.places[0]}, {self.places[1]}, ..., {self.places[-1]} (x {len(self.places)})"


def groups(instances: Mapping[str, Any]) -> list[Group]:
    """Returns the instances of a manifest by groups of equal parts, the largest first."""
    systems: dict[str, list[tuple[str, str, float]]] = {}
    for name, one in instances.items():
        place, _, own = name.rpartition(".")
        fmu = Path(str(one.get("fmu", ""))).name
        systems.setdefault(place, []).append((own, fmu, float(one.get("step") or 0.0)))
    alike: dict[tuple[tuple[str, str, float], ...], list[str]] = {}
    for place in sorted(systems, key=natural):
        alike.setdefault(tuple(sorted(systems[place])), []).append(place)
    return sorted((Group(tuple(places), members) for members, places in alike.items()), key=lambda g: -len(g.places))


def draw_structure(manifest: Mapping[str, Any]) -> str:
    """Returns the drawing of a system, an SVG document."""
    found = groups(manifest.get("instances", {}))
    shown, network = found[:_MOST], manifest.get("network", {})
    nsmap: Any = {None: _SVG}
    root = etree.Element(f"{{{_SVG}}}svg", nsmap=nsmap)
    _add(root, "style", {}, _STYLE)
    widths = [_width(group) for group in shown]
    on_air = bool(manifest.get("packets", {}).get("sent"))
    top = _LANE if on_air else _PAD
    total = max(sum(widths) + _GAP * max(0, len(widths) - 1), 420.0) + 2 * _PAD
    height = top + max((_LINE * (2 * len(group.members) + 1.6) + 2 * _PAD for group in shown), default=0.0) + 2 * _PAD
    x = _PAD
    for group, width in zip(shown, widths, strict=True):
        if on_air:
            _add(root, "path", {"class": "link", "d": f"M{x + width / 2:.1f},{_PAD + 44:.1f} V{top:.1f}"})
        _draw_group(root, group, x, top, width)
        x += width + _GAP
    if on_air:
        box = {"class": "radio", "x": f"{_PAD}", "y": f"{_PAD}", "width": f"{total - 2 * _PAD:.1f}", "height": "44"}
        _add(root, "rect", {**box, "rx": "6"})
        _add(root, "text", {"class": "name", "x": f"{2 * _PAD}", "y": f"{_PAD + 18}"}, "radio")
        _add(root, "text", {"x": f"{2 * _PAD}", "y": f"{_PAD + 35}"}, _radio(network))
    if len(found) > len(shown):
        others = sum(len(group.places) for group in found[_MOST:])
        _add(root, "text", {"class": "light", "x": f"{_PAD}", "y": f"{height:.1f}"}, f"and {others} other systems")
        height += _LINE
    root.set("viewBox", f"0 0 {total:.0f} {height:.0f}")
    root.set("width", f"{total:.0f}")
    root.set("height", f"{height:.0f}")
    return etree.tostring(root, encoding="unicode")


def _add(parent: etree._Element, tag: str, attributes: Mapping[str, str], text: str = "") -> None:
    element = etree.SubElement(parent, f"{{{_SVG}}}{tag}", dict(attributes))
    if text:
        element.text = _printable(text)


def _printable(text: str) -> str:
    """Returns a text without the characters that XML does not have."""
    return re.sub(r"[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]", "\ufffd", text)


def _width(group: Group) -> float:
    texts = [group.title, *(f"{fmu}, {step:g} s" for _, fmu, step in group.members), *(n for n, _, _ in group.members)]
    return max(120.0, _LETTER * max(map(len, texts)) + 4 * _PAD)


def _draw_group(root: etree._Element, group: Group, x: float, y: float, width: float) -> None:
    for copy in range(min(len(group.places), 3) - 1, -1, -1):  # a stack of cards
        shift = 4.0 * copy
        height = _LINE * (2 * len(group.members) + 1.6) + 2 * _PAD
        where = {"x": f"{x + shift:.1f}", "y": f"{y + shift:.1f}", "width": f"{width:.1f}", "height": f"{height:.1f}"}
        _add(root, "rect", {"class": "group", "rx": "5", **where})
    _add(root, "text", {"class": "name", "x": f"{x + _PAD:.1f}", "y": f"{y + _LINE:.1f}"}, group.title)
    at = y + 1.4 * _LINE
    for name, fmu, step in group.members:
        where = {
            "x": f"{x + _PAD:.1f}",
            "y": f"{at:.1f}",
            "width": f"{width - 2 * _PAD:.1f}",
            "height": f"{1.9 * _LINE:.1f}",
        }
        _add(root, "rect", {"class": "fmu", "rx": "3", **where})
        _add(root, "text", {"x": f"{x + 1.6 * _PAD:.1f}", "y": f"{at + 13:.1f}"}, name)
        told = f"{fmu}, {step:g} s"
        _add(root, "text", {"class": "light", "x": f"{x + 1.6 * _PAD:.1f}", "y": f"{at + 27:.1f}"}, told)
        at += 2.05 * _LINE


def _radio(network: Mapping[str, Any]) -> str:
    told = [str(network.get("topology", ""))]
    told += [
        f"{name} {network[name]:g}{unit}" for name, unit in _NUMBERS if isinstance(network.get(name), (int, float))
    ]
    told += [f"{len(network[name])} {name}" for name in ("outages", "partitions", "jamming") if network.get(name)]
    return ", ".join(part for part in told if part)


_NUMBERS = (("latency", " s"), ("jitter", " s"), ("loss", ""), ("range", " m"), ("rate", " bit/s"))
