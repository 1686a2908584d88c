"""MAVLink 2 signing at gateways, with pymavlink at the other end."""

from __future__ import annotations

import hashlib
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.network.gateways.gateways import Address, Gateways, gateways_of
from cosim_master.network.gateways.signing import Signing, read_key
from cosim_master.system.settings.network import Gateway, Network

KEY = hashlib.sha256(b"a pass phrase").digest()
EPOCH = 1_420_070_400
TICKS = 100_000
"""Of a timestamp in a second."""
NOW = 1_800_000_000


def pymavlink(key: bytes = KEY, *, at: float = NOW, link_id: int = 3, system: int = 255) -> Any:
    """A pymavlink connection that signs, and takes signed packets only."""
    link = mavlink.MAVLink(None, srcSystem=system, srcComponent=190)
    link.signing.secret_key = key
    link.signing.link_id = link_id
    link.signing.timestamp = round((at - EPOCH) * TICKS)
    link.signing.sign_outgoing = True
    return link


def heartbeat(link: Any) -> bytes:
    return bytes(link.heartbeat_encode(6, 8, 0, 0, 0).pack(link))


@pytest.fixture
def signing() -> Signing:
    return Signing(KEY, lambda: float(NOW))


def test_a_genuine_packet_is_accepted(signing: Signing) -> None:
    link = pymavlink()
    assert [signing.refusal(heartbeat(link)) for _ in range(3)] == ["", "", ""]


def test_an_unsigned_packet_is_refused(signing: Signing) -> None:
    link = mavlink.MAVLink(None, srcSystem=255)
    message = link.heartbeat_encode(6, 8, 0, 0, 0)
    assert signing.refusal(bytes(message.pack(link))) == "unsigned"
    assert signing.refusal(bytes(message.pack(link, force_mavlink1=True))) == "unsigned"


def test_a_packet_signed_with_another_key_is_refused(signing: Signing) -> None:
    assert signing.refusal(heartbeat(pymavlink(bytes(32)))) == "bad signature"


@given(st.integers(min_value=1), st.integers(1, 255))
def test_a_tampered_packet_is_refused(place: int, change: int) -> None:
    packet = bytearray(heartbeat(pymavlink()))
    place = 3 + place % (len(packet) - 3)  # magic, length and flags decide that it is a signed packet at all
    packet[place] ^= change
    assert Signing(KEY, lambda: float(NOW)).refusal(bytes(packet)) == "bad signature"


def test_a_replayed_packet_is_refused(signing: Signing) -> None:
    link = pymavlink()
    first, second = heartbeat(link), heartbeat(link)
    assert signing.refusal(second) == ""
    assert signing.refusal(first) == "replayed"
    assert signing.refusal(second) == "replayed"
    assert signing.refusal(heartbeat(link)) == ""


def test_streams_have_timestamps_of_their_own(signing: Signing) -> None:
    ahead, behind = pymavlink(at=NOW + 30), pymavlink(at=NOW - 20, link_id=4)
    other = pymavlink(at=NOW - 20, system=254)
    assert [signing.refusal(heartbeat(link)) for link in (ahead, behind, other)] == ["", "", ""]


def test_a_stream_may_begin_a_minute_late_and_no_later(signing: Signing) -> None:
    assert signing.refusal(heartbeat(pymavlink(at=NOW - 59))) == ""
    assert signing.refusal(heartbeat(pymavlink(at=NOW - 61, link_id=4))) == "replayed"
    assert signing.refusal(heartbeat(pymavlink(at=NOW + 30, link_id=5))) == ""
    assert signing.refusal(heartbeat(pymavlink(at=NOW - 31, link_id=6))) == "replayed"


MESSAGES = [
    lambda m: m.heartbeat_encode(2, 3, 81, 4, 3),
    lambda m: m.command_ack_encode(400, 0, 0, 0, 255, 190),
    lambda m: m.statustext_encode(6, b"hello"),
    lambda m: m.attitude_encode(1, 0.5, -0.5, 1e-9, 0, 0, 0),
]


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("make", MESSAGES)
def test_what_leaves_is_signed_so_that_pymavlink_accepts_it(signing: Signing, make: Any, version: int) -> None:
    sender = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    sender.seq = 200
    message = make(sender)
    packet = bytes(message.pack(sender, force_mavlink1=version == 1))
    receiver = pymavlink()
    receiver.signing.allow_unsigned_callback = None
    for _ in range(2):
        (read,) = receiver.parse_buffer(signing.sign(packet))
        assert read.get_signed()
        plain = mavlink.MAVLink(None).parse_buffer(packet)[0]
        assert read.to_dict() == plain.to_dict()
        assert (read.get_srcSystem(), read.get_srcComponent(), read.get_seq()) == (7, 1, 200)
    assert receiver.total_receive_errors == 0


def test_a_signature_that_a_packet_has_is_replaced(signing: Signing) -> None:
    packet = heartbeat(pymavlink(bytes(32)))
    (read,) = pymavlink().parse_buffer(signing.sign(packet))
    assert read.get_type() == "HEARTBEAT"
    assert len(signing.sign(packet)) == len(packet)


def test_messages_of_unknown_dialects_can_be_signed(signing: Signing) -> None:
    """Their CRC_EXTRA is in the CRC they have: here 123 of message 52000, which no dialect of ours has."""
    body = bytes((2, 0, 0, 9, 7, 1)) + (52000).to_bytes(3, "little") + b"\x05\x06"
    packet = b"\xfd" + body + _crc(body + b"\x7b")
    signed = signing.sign(packet)
    body = bytes((2, 1)) + body[2:]
    assert signed[1:-15] == body
    assert signed[-15:-13] == _crc(body + b"\x7b")
    assert signed[-6:] == hashlib.sha256(KEY + signed[:-6]).digest()[:6]


def _crc(block: bytes) -> bytes:
    from pymavlink.generator.mavcrc import x25crc

    return int(x25crc(block).crc).to_bytes(2, "little")


def test_timestamps_grow_even_when_the_clock_does_not(signing: Signing) -> None:
    packet = bytes(mavlink.MAVLink(None).heartbeat_encode(2, 3, 0, 0, 3).pack(mavlink.MAVLink(None)))
    stamps = [int.from_bytes(signing.sign(packet)[-12:-6], "little") for _ in range(3)]
    assert stamps[0] == round((NOW - EPOCH) * TICKS)
    assert stamps == [stamps[0], stamps[0] + 1, stamps[0] + 2]


# ---- keys and gateways -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("content", [KEY, KEY.hex().encode(), KEY.hex().upper().encode() + b"\n"])
def test_a_key_is_32_bytes_or_64_digits(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "key").write_bytes(content)
    assert read_key(tmp_path / "key") == KEY
    ((_, address),) = gateways_of(Network(), [f"tcp:5760,sign={tmp_path / 'key'}"])
    assert address.key == KEY


@pytest.mark.parametrize("content", [b"", KEY[:31], KEY.hex().encode()[:-2], b"g" * 64])
def test_anything_else_is_no_key(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "key").write_bytes(content)
    with pytest.raises(SystemDescriptionError, match="holds no key: 32 bytes or 64 hexadecimal digits are valid"):
        gateways_of(Network(), [f"tcp:5760,sign={tmp_path / 'key'}"])


@pytest.fixture
def signed_gateway() -> Iterator[Any]:
    """Opens a gateway with KEY, and pymavlink with a key at its other end: (exchange, counts, admitted, send)."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        peer.bind(("127.0.0.1", 0))
        peer.settimeout(60)
        asked = [(Gateway("@gcs"), Address("udpout", "127.0.0.1", peer.getsockname()[1], KEY))]

        class Loop:
            network = Network()
            admitted: list[bytes] = []  # noqa: RUF012
            leaving = bytes(mavlink.MAVLink(None, srcSystem=1).heartbeat_encode(2, 3, 0, 0, 3).pack(mavlink.MAVLink(0)))

            def admit(self, gateway: int, packets: list[bytes]) -> None:
                self.admitted += packets

            def take(self, gateway: int) -> bytes:
                block, self.leaving = self.leaving, b""
                return block

            def waiting(self, gateway: int) -> int:
                return 0

        with Gateways(asked, lambda _: None) as gateways:
            loop: Any = Loop()
            gateways.exchange(loop)
            packet, address = peer.recvfrom(1000)

            def send(packets: list[bytes], expected: dict[str, int]) -> list[bytes]:
                for one in packets:
                    peer.sendto(one, address)
                end = time.monotonic() + 60
                while time.monotonic() < end:
                    gateways.exchange(loop)
                    counts = gateways.counts()["@gcs"]
                    if all(counts.get(name) == n for name, n in expected.items()):
                        return list(loop.admitted)
                raise AssertionError(gateways.counts())

            yield packet, send


def test_a_gateway_with_a_key_drops_and_counts(signed_gateway: Any) -> None:
    packet, send = signed_gateway
    link = pymavlink(at=time.time())
    assert pymavlink(at=NOW - 10**9).parse_buffer(packet)[0].get_type() == "HEARTBEAT"
    first, second = heartbeat(link), heartbeat(link)
    tampered = bytearray(heartbeat(link))
    tampered[-1] ^= 1
    link.signing.sign_outgoing = False
    plain = heartbeat(link)
    wrong = heartbeat(pymavlink(bytes(32), at=time.time()))
    expected = {"received": 2, "unsigned": 1, "replayed": 1, "bad signature": 2}
    admitted = send([first, plain, second, first, bytes(tampered), wrong], expected)
    assert admitted == [first, second]
