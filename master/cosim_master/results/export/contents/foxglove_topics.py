"""The topics of Foxglove and their messages, in a file (`mcap`) and while a run goes on (`view.programs`).

/tf                foxglove.FrameTransforms  all vehicles, from "map" (ENU) to the vehicle's name (FLU)
/NAME/pose         foxglove.PoseInFrame
/NAME/fix          foxglove.LocationFix      if the local origin is known
/signals/INSTANCE  JSON                      all recorded signals of an instance, arrays as lists, for plots
/log               foxglove.Log              STATUSTEXT of all nodes, and the findings of the verdict
/scene             foxglove.SceneUpdate      a body and its name for each vehicle; in a file also its path
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
import pyarrow as pa

from cosim_master.results.export.contents.variables import Recorded

__all__ = ["MAP", "PoseTopics", "json_message", "scene", "signal_channel", "timestamp"]

Vectors: TypeAlias = Sequence[Sequence[float]]

MAP = "map"
"""The frame of the local origin, ENU."""
_SIZE = 0.4  # m, of the body in the scene


def timestamp(stamp: int) -> Any:
    """Returns a time [ns since 1970]."""
    from foxglove.messages import Timestamp

    return Timestamp(stamp // 10**9, stamp % 10**9)


class PoseTopics:
    """The topics of the motion of all vehicles.

    Args:
        context: of the channels.
        names: of the vehicles.
        on_earth: whether geodetic positions are known.
    """

    def __init__(self, context: Any, names: Sequence[str], *, on_earth: bool) -> None:
        from foxglove import channels

        self._names = names
        self._transforms = channels.FrameTransformsChannel("/tf", context=context)
        self._poses = [channels.PoseInFrameChannel(f"/{name}/pose", context=context) for name in names]
        self._fixes = [channels.LocationFixChannel(f"/{name}/fix", context=context) for name in names if on_earth]

    @property
    def has_readers(self) -> bool:
        """True if a file is open, or a client has subscribed to one of the topics."""
        everything: list[Any] = [self._transforms, *self._poses, *self._fixes]
        return any(channel.has_sinks() for channel in everything)

    def log(self, stamp: int, places: Vectors, turns: Vectors, fixes: Vectors) -> None:
        """Writes one instant.

        Args:
            stamp: ns since 1970.
            places: m, ENU, by vehicle.
            turns: quaternions x, y, z, w that rotate FLU into ENU, by vehicle.
            fixes: latitude and longitude [degrees] and altitude [m], by vehicle; ignored if they are not known.
        """
        from foxglove.messages import (
            FrameTransform,
            FrameTransforms,
            LocationFix,
            Pose,
            PoseInFrame,
            Quaternion,
            Vector3,
        )

        time, frames = timestamp(stamp), []
        for name, channel, (x, y, z), (qx, qy, qz, qw) in zip(self._names, self._poses, places, turns, strict=True):
            place, turn = Vector3(x=x, y=y, z=z), Quaternion(x=qx, y=qy, z=qz, w=qw)
            frames.append(
                FrameTransform(
                    timestamp=time, parent_frame_id=MAP, child_frame_id=name, translation=place, rotation=turn
                )
            )
            here = PoseInFrame(timestamp=time, frame_id=MAP, pose=Pose(position=place, orientation=turn))
            channel.log(here, log_time=stamp)
        for name, fix, (latitude, longitude, altitude) in zip(self._names, self._fixes, fixes, strict=False):
            found = LocationFix(
                timestamp=time, frame_id=name, latitude=latitude, longitude=longitude, altitude=altitude
            )
            fix.log(found, log_time=stamp)
        self._transforms.log(FrameTransforms(transforms=frames), log_time=stamp)


def scene(stamp: int, names: Sequence[str], paths: Mapping[str, Vectors]) -> Any:
    """Returns the SceneUpdate with a body and a name for each vehicle, and the paths [m, ENU] of some of them."""
    from foxglove.messages import (
        Color,
        CubePrimitive,
        LinePrimitive,
        LinePrimitiveLineType,
        Point3,
        Pose,
        Quaternion,
        SceneEntity,
        SceneUpdate,
        TextPrimitive,
        Vector3,
    )

    upright = Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
    time, entities = timestamp(stamp), []
    for name in names:
        body = CubePrimitive(
            pose=Pose(position=Vector3(x=0.0, y=0.0, z=0.0), orientation=upright),
            size=Vector3(x=_SIZE, y=_SIZE, z=_SIZE / 4),
            color=Color(r=0.1, g=0.4, b=0.8, a=1.0),
        )
        text = TextPrimitive(
            pose=Pose(position=Vector3(x=0.0, y=0.0, z=_SIZE), orientation=upright),
            text=name,
            billboard=True,
            font_size=12.0,
            scale_invariant=True,
            color=Color(r=0.1, g=0.1, b=0.1, a=1.0),
        )
        entities.append(
            SceneEntity(timestamp=time, frame_id=name, id=name, frame_locked=True, cubes=[body], texts=[text])
        )
        if name in paths:
            line = LinePrimitive(
                type=LinePrimitiveLineType.LineStrip,
                pose=Pose(position=Vector3(x=0.0, y=0.0, z=0.0), orientation=upright),
                thickness=1.0,
                scale_invariant=True,
                points=[Point3(x=x, y=y, z=z) for x, y, z in paths[name]],
                color=Color(r=0.5, g=0.5, b=0.5, a=0.6),
            )
            entities.append(SceneEntity(timestamp=time, frame_id=MAP, id=f"{name} path", lines=[line]))
    return SceneUpdate(entities=entities)


def signal_channel(context: Any, instance: str, variables: Mapping[str, Recorded]) -> Any:
    """Returns the channel of an instance's signals, with a schema that gives units and descriptions."""
    import foxglove

    properties = {name: _kind(one) for name, one in variables.items()}
    schema = {"type": "object", "title": instance, "properties": properties}
    return foxglove.Channel(f"/signals/{instance}", schema=schema, message_encoding="json", context=context)


def _kind(one: Recorded) -> dict[str, Any]:
    kind = "string" if pa.types.is_string(one.type) else "boolean" if pa.types.is_boolean(one.type) else "number"
    about = one.description + (f" [{one.unit}]" if one.unit else "")
    if one.is_array:
        return {"type": "array", "items": {"type": kind}, "description": about}
    return {"type": kind, "description": about}


def json_message(values: Mapping[str, Any]) -> bytes:
    """Returns the message of an instance's signals: values, or lists of the elements of arrays, by variable."""
    finite = {n: [_json(v) for v in of] if isinstance(of, list) else _json(of) for n, of in values.items()}
    return json.dumps(finite, ensure_ascii=False).encode("utf-8", "replace")


def _json(value: Any) -> Any:
    """Returns a value of JSON, which has neither NaN nor infinity: null."""
    return None if isinstance(value, float) and not np.isfinite(value) else value
