"""Lets MAVSDK and MAVProxy call ours and ArduCopter, and prints which outcomes differ.

The functions of MAVSDK's client plug-ins (`clients_mavsdk`) and common commands of MAVProxy's modules
(`mavproxy_calls`) are called on one quadrotor, first on the ground, then in flight. Ours is a run of `line5-script`
with one drone; ArduCopter, which ARDUPILOT_SITL names, flies its own physics. Without it, ours is
compared with the outcomes in `clients.json`, which `--record` writes. A client is started when its vehicle sends, after
the run has been compiled. What fails leaves its folder with the logs of vehicle and client, and says where.

    python -m benchmarks.clients [--clients mavsdk mavproxy] [--json FILE] [--docs FILE]
    ARDUPILOT_SITL=... python -m benchmarks.clients --record
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from benchmarks.report import machine, section, show, write

HERE = Path(__file__).parent
RECORDED = HERE / "clients.json"
CLIENTS = ("mavsdk", "mavproxy")
PACE = 2.0
"""Simulated seconds per second of both vehicles."""
LIMIT = 1500.0
"""Seconds for all calls of a client."""
PATIENCE = 900.0
"""Seconds until a vehicle sends its first packet; where nothing is compiled yet, a run takes minutes for that."""
TOLD = 2000
"""Characters of a log's end that a failure tells."""
HOME = (-35.363262, 149.165237, 584)
PLACE = "{}\t{}\t{}\t{}\t{}\t0\t0\t0\t{}\t{}\t{}\t1"
PLANS = {
    "mission": (
        (0, 1, 0, 16, 0, *HOME),
        (1, 0, 3, 22, 0, 0, 0, 10),
        (2, 0, 3, 16, 0, -35.3632, 149.1651, 12),
        (3, 0, 3, 16, 0, -35.3631, 149.1651, 12),
        (4, 0, 3, 20, 0, 0, 0, 0),
    ),
    "fence": tuple(
        (i, 0, 3, 5001, 4, lat, lon, 0)
        for i, (lat, lon) in enumerate(
            ((-35.3622, 149.1642), (-35.3622, 149.1662), (-35.3642, 149.1662), (-35.3642, 149.1642))
        )
    ),
    "rally": ((0, 0, 3, 5100, 0, -35.3631, 149.1653, 20),),
}
"""Plans that MAVProxy loads: number, current, frame, command, first parameter, place."""


def free_port() -> int:
    """A UDP port that nobody uses."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def await_packet(port: int, process: subprocess.Popen[bytes], patience: float = PATIENCE) -> None:
    """Waits until a vehicle sends to a port that nobody listens to yet.

    Raises:
        RuntimeError: it has ended, or sends nothing.
    """
    end = time.monotonic() + patience
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind(("127.0.0.1", port))
        one.settimeout(0.2)
        while time.monotonic() < end:
            with suppress(TimeoutError):
                one.recv(65536)
                return
            if process.poll() is not None:
                raise RuntimeError(f"the vehicle has ended with {process.returncode} before its first packet")
    raise RuntimeError(f"the vehicle has sent nothing for {patience:g} s")


@contextmanager
def kept_if_it_fails(name: str) -> Iterator[Path]:
    """A folder that is removed, unless what is done with it fails.

    Raises:
        SystemExit: that has failed; it names the folder and tells the ends of the logs in it.
    """
    folder = Path(tempfile.mkdtemp(prefix="uav-cosim-clients-"))
    try:
        yield folder
    except (OSError, RuntimeError, ValueError, subprocess.SubprocessError) as error:
        logs = [f"{log}:\n{log.read_text(errors='replace')[-TOLD:]}" for log in sorted(folder.glob("*.log"))]
        raise SystemExit("\n".join([f"{name}: {str(error).rstrip('.')}; its files are in {folder}", *logs])) from error
    shutil.rmtree(folder)


@contextmanager
def program(command: Sequence[str], folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Runs a vehicle in a folder; ends it afterwards."""
    with (folder / "vehicle.log").open("w") as log:
        process = subprocess.Popen(command, cwd=folder, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(60)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def ours(folder: Path, port: int) -> list[str]:
    """The command of a run with one drone, whose port sends to a client."""
    cli = [sys.executable, "-c", "from cosim_master.cli import main; main()"]
    made = [*cli, "new", "line5-script", "--drones", "1", "-o", str(folder / "one")]
    subprocess.run(made, check=True, stdout=subprocess.DEVNULL)
    run = [*cli, "run", str(folder / "one"), "-o", str(folder / "out"), "--until", "9000", "--pace", str(PACE)]
    return [*run, "--dataflash", "--set", "recording.interval=0.1", "--ports", f"udpout:127.0.0.1:{port}"]


def arducopter(folder: Path, port: int) -> list[str]:
    """The command of an ArduCopter whose first port sends to a client."""
    executable = Path(os.environ["ARDUPILOT_SITL"]).resolve()
    (folder / "frame.parm").write_text("FRAME_CLASS 1\nFRAME_TYPE 1\n")
    defaults = executable.parents[3] / "Tools" / "autotest" / "default_params" / "copter.parm"
    files = [str(file) for file in (defaults, folder / "frame.parm") if file.is_file()]
    where = ",".join(map(str, (*HOME, 0)))
    options = [
        "--model",
        "quad",
        "--home",
        where,
        "--speedup",
        str(PACE),
        "--start-time",
        "1735689600",
        "-I",
        str(200 + port % 40),
    ]
    serial = ["--serial0", f"udpclient:127.0.0.1:{port}", "--serial1", "none", "--serial2", "none"]
    return [str(executable), *options, "--defaults", ",".join(files), *serial]


def called(client: str, folder: Path, port: int) -> dict[str, str]:
    """Lets a client make all its calls; outcomes by call, with a number where one is made again."""
    listens = f"127.0.0.1:{port}"
    outcomes = folder / "outcomes"
    environment = dict(os.environ)
    if client == "mavsdk":
        command = [sys.executable, str(HERE / "clients_mavsdk.py"), f"udpin://{listens}", str(outcomes)]
    else:
        for name, rows in PLANS.items():
            lines = ["QGC WPL 110", *(PLACE.format(*row) for row in rows)]
            (folder / name).write_text("\n".join(lines) + "\n")
        command = [sys.executable, "-m", "MAVProxy.mavproxy", "--master", f"udpin:{listens}", "--daemon"]
        command += ["--non-interactive", "--state-basedir", str(folder)]
        command += ["--load-module", "gimbal,messagerate,message,mavproxy_calls"]
        paths = os.pathsep.join(filter(None, (str(HERE), environment.get("PYTHONPATH", ""))))
        environment |= {"HOME": str(folder), "PYTHONPATH": paths}
        environment |= {"MAVPROXY_FOLDER": str(folder), "MAVPROXY_OUTCOMES": str(outcomes)}
    with (folder / "client.log").open("w") as log:
        subprocess.run(
            command,
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=log,
            timeout=LIMIT,
            check=True,
        )
    return read(outcomes)


def read(file: Path) -> dict[str, str]:
    """The outcomes that a client has written."""
    found: dict[str, str] = {}
    times: Counter[str] = Counter()
    for line in file.read_text().splitlines():
        one = json.loads(line)
        times[one["call"]] += 1
        again = f" ({times[one['call']]})" if times[one["call"]] > 1 else ""
        found[one["call"] + again] = one["outcome"]
    return found


def outcomes_of(vehicle: str, client: str) -> dict[str, str]:
    """All outcomes of a client's calls on one vehicle."""
    with kept_if_it_fails(f"{client} with {vehicle}") as folder:
        port = free_port()
        command = ours(folder, port) if vehicle == "ours" else arducopter(folder, port)
        with program(command, folder) as process:
            await_packet(port, process)
            return called(client, folder, port)


def differing(ours: Mapping[str, str], theirs: Mapping[str, str]) -> list[tuple[str, str, str]]:
    """The calls whose outcomes differ, with ours and theirs."""
    calls = dict.fromkeys([*theirs, *ours])
    return [(call, ours.get(call, "-"), theirs.get(call, "-")) for call in calls if ours.get(call) != theirs.get(call)]


def documented(found: Mapping[str, tuple[int, list[tuple[str, str, str]]]]) -> list[str]:
    """The lines of the document's tables."""
    lines: list[str] = []
    for client, (calls, rows) in found.items():
        name = {"mavsdk": "MAVSDK", "mavproxy": "MAVProxy"}[client]
        lines += [f"{name}: {calls - len(rows)} of {calls} outcomes are equal.", ""]
        if rows:
            lines += ["| call | ours | ArduCopter |", "|---|---|---|"]
            lines += [f"| `{call}` | {one or 'nothing'} | {other or 'nothing'} |" for call, one, other in rows]
            lines.append("")
    return lines[:-1]


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("--clients", nargs="+", choices=CLIENTS, default=CLIENTS)
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--docs", type=Path, metavar="FILE")
    parser.add_argument("--record", action="store_true", help="write ArduCopter's outcomes to clients.json")
    options = parser.parse_args(arguments)
    kept: dict[str, dict[str, str]] = json.loads(RECORDED.read_text()) if RECORDED.is_file() else {}
    real = bool(os.environ.get("ARDUPILOT_SITL"))
    found: dict[str, tuple[int, list[tuple[str, str, str]]]] = {}
    for client in options.clients:
        theirs = outcomes_of("arducopter", client) if real else kept[client]
        kept[client] = theirs
        found[client] = len(theirs), differing(outcomes_of("ours", client), theirs)
    if real and options.record:
        RECORDED.write_text(json.dumps(kept, indent=0) + "\n")
    host = machine("mavsdk", "MAVProxy")
    for client, (calls, rows) in found.items():
        note = f"{calls - len(rows)} of {calls} outcomes equal those of {'ArduCopter' if real else 'the recorded one'}"
        show(client, host, ["call", "ours", "ArduCopter"], [list(row) for row in rows], note)
    if options.docs is not None:
        section(options.docs, "clients", "clients", documented(found))
    write(options.json, host, {"benchmark": "clients", "differ": {client: rows for client, (_, rows) in found.items()}})


if __name__ == "__main__":
    main()
