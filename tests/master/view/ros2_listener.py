"""A DDS program of its own: python ros2_listener.py DOMAIN. It has its own types, and none of this project's code.

It prints "ready" when it listens, then a line for each message: topic, and its CDR in base64. It ends 2 s after the
last one.
"""

import base64
import sys
import time
from dataclasses import dataclass
from typing import Any

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float64, int8, int32, sequence, uint8, uint16, uint32, uint64
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic


def struct(name: str, **fields: Any) -> Any:
    """A type of DDS, with the name that ROS gives it: "package/Type"."""
    package, _, kind = name.partition("/")
    space = {"__annotations__": fields}
    return dataclass(type(kind, (IdlStruct,), space, typename=f"{package}::msg::dds_::{kind}_"))


def vector(name: str, axes: str) -> Any:
    return struct(name, **dict.fromkeys(axes, float64))


TIME = struct("builtin_interfaces/Time", sec=int32, nanosec=uint32)
HEADER = struct("std_msgs/Header", stamp=TIME, frame_id=str)
QUATERNION, VECTOR = vector("geometry_msgs/Quaternion", "xyzw"), vector("geometry_msgs/Vector3", "xyz")
POSE = struct("geometry_msgs/Pose", position=vector("geometry_msgs/Point", "xyz"), orientation=QUATERNION)
TWIST = struct("geometry_msgs/Twist", linear=VECTOR, angular=VECTOR)
POSED = struct("geometry_msgs/PoseStamped", header=HEADER, pose=POSE)
UNSURE_POSE = struct("geometry_msgs/PoseWithCovariance", pose=POSE, covariance=array[float64, 36])
UNSURE_TWIST = struct("geometry_msgs/TwistWithCovariance", twist=TWIST, covariance=array[float64, 36])
ODOMETRY = struct("nav_msgs/Odometry", header=HEADER, child_frame_id=str, pose=UNSURE_POSE, twist=UNSURE_TWIST)
FIX = struct(
    "sensor_msgs/NavSatFix",
    header=HEADER,
    status=struct("sensor_msgs/NavSatStatus", status=int8, service=uint16),
    **dict.fromkeys(("latitude", "longitude", "altitude"), float64),
    position_covariance=array[float64, 9],
    position_covariance_type=uint8,
)
TRANSFORM = struct("geometry_msgs/Transform", translation=VECTOR, rotation=QUATERNION)
TRANSFORMED = struct("geometry_msgs/TransformStamped", header=HEADER, child_frame_id=str, transform=TRANSFORM)
FRAMES = struct("tf2_msgs/TFMessage", transforms=sequence[TRANSFORMED])
CLOCK = struct("rosgraph_msgs/Clock", clock=TIME)
TWISTED = struct("geometry_msgs/TwistStamped", header=HEADER, twist=TWIST)
MAVLINK = struct(
    "mavros_msgs/Mavlink",
    header=HEADER,
    **dict.fromkeys(
        ("framing_status", "magic", "len", "incompat_flags", "compat_flags", "seq", "sysid", "compid"), uint8
    ),
    msgid=uint32,
    checksum=uint16,
    payload64=sequence[uint64],
    signature=sequence[uint8],
)

LOOPBACK = """<CycloneDDS><Domain><General><Interfaces><NetworkInterface address="127.0.0.1" multicast="false"/>
</Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>
<MaxAutoParticipantIndex>100</MaxAutoParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain>
</CycloneDDS>"""
KINDS = {"tf": FRAMES, "drone2/pose": POSED, "drone2/odom": ODOMETRY, "drone2/fix": FIX}
KINDS |= {"clock": CLOCK, "drone2/mavlink_source": MAVLINK}


def main(number: int) -> None:
    domain = Domain(number, LOOPBACK)
    participant = DomainParticipant(number)
    qos = Qos(Policy.Reliability.BestEffort, Policy.History.KeepAll)
    readers = {
        name: DataReader(participant, Topic(participant, f"rt/{name}", kind), qos=qos) for name, kind in KINDS.items()
    }
    print("ready", flush=True)
    seen, gone = False, 0.0
    while not seen or gone < 100:
        news = 0
        for name, reader in readers.items():
            for message in reader.take(100):
                news += 1
                print(name, base64.b64encode(message.serialize()).decode(), flush=True)
        seen = seen or news > 0
        gone = 0.0 if news else gone + 1
        time.sleep(0.02)
    del readers, participant, domain


if __name__ == "__main__":
    main(int(sys.argv[1]))
