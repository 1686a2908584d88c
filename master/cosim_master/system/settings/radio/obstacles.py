"""Obstacles in the way of radio signals, from the network's annotation."""

from __future__ import annotations

from dataclasses import dataclass

from cosim_master.system.settings.annotation import Attributes

__all__ = ["Obstacle", "read_box", "read_cylinder"]


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A box (`length` to the north, `width` to the east) or a cylinder (`radius`) around a place; lengths in m.

    It stands `base` above the origin. Signals lose `loss` [dB] in it, and `attenuation` [dB/m] for each metre.
    """

    north: float
    east: float
    length: float
    width: float
    radius: float
    height: float
    base: float
    loss: float
    attenuation: float


def read_box(child: Attributes) -> Obstacle:
    """Reads a `<box>`; adds its problems to those of the reader."""
    length, width = (child.number(name, 0.0, 0.0, 1e6) for name in ("length", "width"))
    return _obstacle(child, "a box needs a length, a width and a height, in m", length=length, width=width)


def read_cylinder(child: Attributes) -> Obstacle:
    """Reads a `<cylinder>`; adds its problems to those of the reader."""
    radius = child.number("radius", 0.0, 0.0, 1e6)
    return _obstacle(child, "a cylinder needs a radius and a height, in m", radius=radius)


def _obstacle(
    child: Attributes, needs: str, *, length: float = 0.0, width: float = 0.0, radius: float = 0.0
) -> Obstacle:
    north, east, base = (child.number(name, 0.0, -1e9, 1e9) for name in ("north", "east", "base"))
    height = child.number("height", 0.0, 0.0, 1e6)
    loss, attenuation = (child.number(name, 0.0, 0.0, 1e6) for name in ("loss", "attenuation"))
    child.finish()
    if height <= 0.0 or (radius <= 0.0 and min(length, width) <= 0.0):
        child.problem(needs)
    if loss <= 0.0 and attenuation <= 0.0:
        child.problem("an obstacle needs a loss, in dB, or an attenuation, in dB/m")
    return Obstacle(north, east, length, width, radius, height, base, loss, attenuation)
