"""Settings that several formats share."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where

__all__ = ["Options", "Origin", "origin_of_text"]


@dataclass(frozen=True, slots=True)
class Origin:
    """The place on Earth of the local origin: latitude and longitude [rad], altitude above mean sea level [m]."""

    latitude: float
    longitude: float
    altitude: float


@dataclass(frozen=True, slots=True)
class Options:
    """Settings of an export.

    Attributes:
        numbers_only: leave out signals of text.
        origin: the local origin; None takes the one that the models declare.
    """

    numbers_only: bool = False
    origin: Origin | None = None


def origin_of_text(text: str) -> Origin:
    """Returns the origin written as "LATITUDE,LONGITUDE,ALTITUDE", in degrees and m.

    Raises:
        SystemDescriptionError: the text has another form.
    """
    try:
        latitude, longitude, altitude = map(float, text.split(","))
    except ValueError:
        form = "write LATITUDE,LONGITUDE,ALTITUDE in degrees and m, as 48.1,11.6,520"
        raise SystemDescriptionError([Problem(Where(f"origin {text}"), form)]) from None
    if not (abs(latitude) < 90.0 and abs(longitude) <= 180.0 and abs(altitude) < 1e6):
        bounds = "the latitude must be within -90 and 90, the longitude within -180 and 180 degrees, the altitude 1e6 m"
        raise SystemDescriptionError([Problem(Where(f"origin {text}"), bounds)])
    return Origin(radians(latitude), radians(longitude), altitude)
