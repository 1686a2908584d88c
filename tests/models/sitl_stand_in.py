"""A stand-in for ArduPilot's simulator: its end of the JSON interface and of a serial port, without any flying.

It takes ArduPilot's arguments. Channel 1 says how high it is told to be (1000 + 10 per metre), channel 2 how far north,
channels 3 and 4 stand still, all others are 0, as unused channels are; its first packet says 1000 for all. It writes
every reply it has taken down, a line of JSON each. Its serial port has its turn when 10 ms have passed on its clock. It
says hello in plain text, then sends a HEARTBEAT and another every 0.1 s (ArduPilot: the first after 1 s, then each
second); it answers COMMAND_LONG, which arms it.

STAND_IN is JSON: "log" (a folder), and how it misbehaves: "channels" 32; "repeat" n: every n-th servo packet goes out
twice; "skip" n: every n-th number is left out; "drop" n: the reply to frame n is lost once; "restart" n: begins anew at
frame n; "die" n: ends at frame n; "silent" n: sends nothing from frame n on; "mute": never sends anything.
"""

from __future__ import annotations

import contextlib
import getopt
import json
import os
import re
import socket
import struct
import sys
import time
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as mavlink

HOW: dict[str, Any] = json.loads(os.environ["STAND_IN"])


def number(text: bytes, section: str, key: str) -> list[float]:
    """As ArduPilot reads it: search for the section, then for `"key":`, then read numbers that follow at once."""
    at = text.index(section.encode()) if section else 0
    at = text.index(b'"' + key.encode() + b'":', at) + len(key) + 3
    found = re.compile(rb"\[?(-?[\d.]+(?:e[-+]?\d+)?(?:, ?-?[\d.]+(?:e[-+]?\d+)?)*)").match(text, at)
    assert found is not None, text
    return [float(part) for part in found[1].split(b",")]


class Serial:
    """udpclient:HOST:PORT sends first; tcp:0:wait waits for a client."""

    def __init__(self, how: str, instance: int) -> None:
        kind, *rest = how.split(":")
        if kind == "udpclient":
            self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self.socket.connect((rest[0], int(rest[1])))
        else:
            with socket.socket() as server:
                server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                server.bind(("127.0.0.1", 5760 + 10 * instance))
                server.listen(1)
                self.socket, _ = server.accept()
        self.socket.setblocking(False)

    def read(self) -> bytes:
        try:
            return self.socket.recv(65536)
        except (BlockingIOError, ConnectionError):
            return b""

    def write(self, data: bytes) -> None:
        half = len(data) // 2  # in two pieces: a serial port knows no packets
        with contextlib.suppress(BlockingIOError, ConnectionError):
            for piece in (data[:half], data[half:]):
                if piece:
                    self.socket.send(piece)


class Vehicle:
    """The loop of one simulated autopilot."""

    def __init__(self) -> None:
        self.given = given = {"I": 0, "sysid": 1, "serial0": "tcp:0:wait"}
        names = ("model", "defaults", "home", "speedup", "start-time", "sim-port-out", "sysid")
        names += ("serial0", "serial1", "serial2")
        options, _ = getopt.getopt(sys.argv[1:], "I:", [f"{name}=" for name in names])
        for option, value in options:
            name = option.lstrip("-")
            given[name] = int(value) if name in ("I", "sysid", "sim-port-out") else value
        self.instance = int(given["I"])
        assert 0 <= self.instance < 256, "ArduPilot keeps it in a byte"
        self.to = ("127.0.0.1", int(given.get("sim-port-out", 9002 + 10 * self.instance)))
        self.log = (Path(HOW["log"]) / f"{self.instance}.jsonl").open("a")
        print(json.dumps(given), file=self.log, flush=True)
        self.mavlink = mavlink.MAVLink(None, srcSystem=int(given["sysid"]), srcComponent=1)
        self.armed = False
        self.serial = Serial(str(given["serial0"]), self.instance)
        self.physics = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.physics.settimeout(0.2)
        self.pwm = [1000, 1000, 1000, 1000]
        self.frame = 0
        self.clock = self.turn = 0.0
        self.beat = -1.0
        self.unsent = b"\n\nInit ArduCopter V0.0.0-dev\n\nFree RAM: 524288\n"

    def servos(self) -> bytes:
        channels = HOW.get("channels", 16)
        pwm = [*self.pwm, *([0 if self.frame else 1000] * (channels - 4))]
        return struct.pack(f"<HHI{channels}H", 29569 if channels == 32 else 18458, 1200, self.frame, *pwm)

    def send(self) -> None:
        self.physics.sendto(self.servos(), self.to)
        if self.frame and HOW.get("repeat") and self.frame % HOW["repeat"] == 0:
            self.physics.sendto(self.servos(), self.to)

    def reply(self) -> bytes:
        while True:
            try:
                text = self.physics.recv(65536)
                if self.frame != HOW.get("drop"):
                    return text
                del HOW["drop"]
            except (TimeoutError, ConnectionError):
                time.sleep(0.02)
                self.send()

    def take(self, text: bytes) -> None:
        assert text.startswith(b"\n") and text.endswith(b"\n"), text
        north, east, down = number(text, "", "position")
        taken = {
            "frame": self.frame,
            "timestamp": number(text, "", "timestamp")[0],
            "gyro": number(text, '"imu"', "gyro"),
            "accel_body": number(text, '"imu"', "accel_body"),
            "position": [north, east, down],
            "quaternion": number(text, "", "quaternion"),
            "velocity": number(text, "", "velocity"),
        }
        print(json.dumps(taken), file=self.log, flush=True)
        self.clock = taken["timestamp"]
        assert self.clock > 0.0, "ArduPilot's clock goes by the wall's while it is 0"
        self.pwm = [1000 + round(-10 * down), 1000 + round(10 * north), 1000, 1000]

    def speak(self) -> None:
        """ArduPilot writes, then reads."""
        if self.clock - self.turn <= 0.01:
            return
        self.turn = self.clock
        self.serial.write(self.unsent)
        self.unsent = b""
        for message in self.mavlink.parse_buffer(self.serial.read()) or []:
            if message.get_type() == "COMMAND_LONG":
                self.armed = message.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM
                ack = self.mavlink.command_ack_encode(message.command, 0, 0, 0, message.get_srcSystem(), 0)
                self.unsent += ack.pack(self.mavlink)
                self.beat = -1.0
        if self.clock - self.beat >= 0.1:
            self.beat = self.clock
            message = self.mavlink.heartbeat_encode(2, 3, 217 if self.armed else 89, 4, 4 if self.armed else 3)
            self.unsent += message.pack(self.mavlink)

    def run(self) -> None:
        while True:
            if self.frame == HOW.get("die"):
                print("it is over", flush=True)
                sys.exit(3)
            if "mute" in HOW or self.frame == HOW.get("silent"):
                time.sleep(60)
            if self.frame == HOW.get("restart"):
                del HOW["restart"]
                self.frame = 0
                self.physics = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
                self.physics.settimeout(0.2)
            self.send()
            self.take(self.reply())
            self.speak()
            self.frame += 1
            if HOW.get("skip") and self.frame % HOW["skip"] == 0:
                self.frame += 1


if __name__ == "__main__":
    Vehicle().run()
