"""Set-points from ROS as packets, read by pymavlink; packets as messages of ROS and back; the reasons for refusals."""

from __future__ import annotations

import math
from types import SimpleNamespace as Of
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega

from cosim_master.network.gateways.mailbox import Mailbox
from cosim_master.network.radio.tables import BY_RADIO
from cosim_master.results.reading.roles import Part
from cosim_master.stepping.observation import Packets
from cosim_master.system.settings.network import Network
from cosim_master.system.settings.radio.nodes import Endpoint, Node
from cosim_master.view.live.ground_station import GroundStation
from cosim_master.view.live.traffic import LiveTraffic
from cosim_master.view.programs.ros.mavlink import fields_of, packet_of
from cosim_master.view.programs.ros.setpoints import Setpoints
from tests.master.view.events import events_of

POSE, TWIST, SINK = "d2/setpoint_position/local", "d2/setpoint_velocity/cmd_vel", "d2/mavlink_sink"


class Heard:
    """Two drones, and the packets that reach the mailbox."""

    def __init__(self, systems: tuple[int, ...] = (1, 2)) -> None:
        port: Any = object()
        nodes = tuple(Node(f"drone{i}", (Endpoint(f"drone{i}.autopilot", port, port),)) for i in (1, 2))
        network = Network(nodes=nodes)
        traffic = LiveTraffic(network, [Part(f"drone{i}", f"drone{i}.vehicle", "") for i in (1, 2)])
        events = [(0, 0, i, 1 - i, 0, system, 1, 0, 20, BY_RADIO) for i, system in enumerate(systems) if system]
        traffic.packets(Packets(events_of(events), np.zeros(0, np.uint8)), complete=True)
        self.mailbox, self.told = Mailbox(), list[str]()
        self.mailbox.refusal = ""
        station = GroundStation(network, traffic, self.mailbox, 191)
        self.setpoints = Setpoints({"d1": "drone1", "d2": "drone2"}, station, self.told.append)

    def message(self, topic: str, message: Any) -> Any:
        """What pymavlink reads of the packet made of a message."""
        self.setpoints.take(topic, message)
        (packet,) = self.mailbox.receive()
        (found,) = ardupilotmega.MAVLink(None).parse_buffer(packet)
        return found


def pose(x: float, y: float, z: float, *, w: float = 1.0, up: float = 0.0, frame: str = "map") -> Of:
    place = Of(position=Of(x=x, y=y, z=z), orientation=Of(x=0.0, y=0.0, z=up, w=w))
    return Of(header=Of(frame_id=frame), pose=place)


def twist(x: float, y: float, z: float, rate: float, frame: str = "map") -> Of:
    return Of(header=Of(frame_id=frame), twist=Of(linear=Of(x=x, y=y, z=z), angular=Of(x=0.0, y=0.0, z=rate)))


def test_the_topics() -> None:
    kinds = Heard().setpoints.kinds
    assert kinds[POSE] == "geometry_msgs/msg/PoseStamped" and kinds[TWIST] == "geometry_msgs/msg/TwistStamped"
    assert kinds[SINK] == "mavros_msgs/msg/Mavlink" and len(kinds) == 6


@pytest.mark.parametrize(("to_left", "yaw"), [(0.0, math.pi / 2), (math.pi / 2, 0.0), (3.0, math.pi / 2 - 3.0)])
def test_a_pose_is_a_place_with_a_heading(to_left: float, yaw: float) -> None:
    found = Heard().message(POSE, pose(30.0, 20.0, 10.0, w=math.cos(to_left / 2), up=math.sin(to_left / 2)))
    assert found.get_type() == "SET_POSITION_TARGET_LOCAL_NED"
    assert (found.get_srcSystem(), found.get_srcComponent()) == (255, 191)
    assert (found.target_system, found.target_component, found.coordinate_frame) == (2, 1, 1)
    assert (found.x, found.y, found.z) == (20.0, 30.0, -10.0)
    assert found.yaw == pytest.approx(yaw, abs=1e-6)
    ignored = ardupilotmega.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE | 0b111111000
    assert found.type_mask == ignored


def test_an_orientation_that_is_none_gives_no_heading() -> None:
    found = Heard().message(POSE, pose(1.0, 2.0, 3.0, w=0.0))
    assert found.type_mask & ardupilotmega.POSITION_TARGET_TYPEMASK_YAW_IGNORE and found.yaw == 0.0


def test_a_twist_is_a_velocity_with_a_turning_rate() -> None:
    found = Heard().message(TWIST, twist(1.0, 2.0, 3.0, 0.25, frame=""))
    assert (found.vx, found.vy, found.vz, found.yaw_rate) == (2.0, 1.0, -3.0, -0.25)
    assert found.type_mask == 0b111 | 0b111000000 | ardupilotmega.POSITION_TARGET_TYPEMASK_YAW_IGNORE


@pytest.mark.parametrize(
    ("topic", "message", "reason"),
    [
        (POSE, pose(0.0, 0.0, 0.0, frame="drone1"), 'its frame is "drone1"; give values in "map"'),
        (TWIST, twist(math.nan, 0.0, 0.0, 0.0), "its values must be finite"),
        (POSE, pose(1e7, 0.0, 0.0), "less than 1,000 km"),
        (SINK, Of(framing_status=2, magic=253, payload64=[], signature=[]), "framing_status 2 with magic 253"),
    ],
)
def test_the_reason_why_nothing_is_sent_is_told_once(topic: str, message: Any, reason: str) -> None:
    heard = Heard()
    for _ in range(3):
        heard.setpoints.take(topic, message)
    assert heard.mailbox.receive() == []
    (told,) = heard.told
    assert told.startswith(f"/{topic}: nothing is sent: ") and reason in told


def test_a_run_that_takes_no_packets_says_why() -> None:
    heard = Heard(systems=(1, 0))
    heard.setpoints.take(POSE, pose(0.0, 0.0, 0.0))
    heard.mailbox.refusal = "the run has ended"
    heard.setpoints.take(SINK, Of(**fields_of(ardupilotmega.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(LINK))))
    assert heard.told == [
        f"/{POSE}: nothing is sent: its autopilot has not sent anything yet",
        f"/{SINK}: nothing is sent: the run has ended",
    ]


LINK = ardupilotmega.MAVLink(None, 7, 9)
SIGNING = ardupilotmega.MAVLink(None, 7, 9)
SIGNING.signing.secret_key, SIGNING.signing.sign_outgoing = bytes(range(32)), True


@given(st.sampled_from([LINK, SIGNING]), st.booleans(), st.text("abc ", max_size=50))
def test_packets_pass_as_they_are(link: Any, old: bool, text: str) -> None:
    made = ardupilotmega.MAVLink_statustext_message(4, text.encode())
    data = made.pack(link, force_mavlink1=old)
    fields = fields_of(data)
    assert (fields["msgid"], fields["sysid"], fields["compid"]) == (253, 7, 9)
    assert fields["magic"] == (254 if old else 253) and len(fields["payload64"]) == -(-fields["len"] // 8)
    assert packet_of(Of(**fields)) == data


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"magic": 0}, "framing_status 1 with magic 0 is no valid packet"),
        ({"payload64": []}, "payload64 has 0 bytes, fewer than len, 9"),
        ({"magic": 254, "msgid": 256}, "message 256 has no packet of MAVLink 1"),
        ({"signature": [0] * 13}, "the signature has 13 bytes, not 0"),
        ({"incompat_flags": 1}, "the signature has 0 bytes, not 13"),
    ],
)
def test_messages_that_are_no_packets(change: dict[str, Any], reason: str) -> None:
    fields = fields_of(ardupilotmega.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(LINK))
    with pytest.raises(ValueError, match=reason):
        packet_of(Of(**{**fields, **change}))
