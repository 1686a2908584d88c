"""What a run leaves behind, read back by other means: pyarrow, pymavlink, json; and that it is always the same."""

from __future__ import annotations

import errno
import hashlib
import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest
from pymavlink import mavutil

from cosim.entry import signature_of
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import Listener, RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.network.radio import logs
from cosim_master.results.reading.read import packets, signals
from cosim_master.results.recording import packet_log
from cosim_master.results.recording.packet_log import EPOCH, file_name
from cosim_master.results.repair import repair
from cosim_master.results.storage.journal import Journal, goes_on
from cosim_master.stepping.observation import Seen
from cosim_master.stepping.warming import kernels_of_runs
from tests.master.fmus.probe import model
from tests.master.results.test_journal import broken_off

CHATTER = '''
from cosim import Memory, Model, Output, PacketInput, PacketOutput, Parameter, kernel
from cosim.messages import encode_heartbeat
from cosim.packets import pack

@kernel
def start(m):
    for i in range(3):
        m.position[i] = 0.0
    m.position[1] = m.east
    return 0

@kernel
def advance(m, t, h):
    m.heard = m.heard + m.mavlink_rx_len
    m.mavlink_tx_len = 0
    for i in range(2):
        encode_heartbeat(m.payload, 2, 3, 0, m.sequence, 3, 3)
        n = pack(m.mavlink_tx, m.mavlink_tx_len, m.payload, 0, m.sequence % 256, int(m.id), 1, 2)
        if n < 0:
            return 1
        m.mavlink_tx_len = n
        m.sequence += 1
    return 0

class Chatter(Model):
    """Says two heartbeats a step, and counts the bytes that it hears."""
    step_size = 0.01
    variables = (
        Parameter("id", type=int, start=1),
        Parameter("east", unit="m"),
        PacketInput("mavlink_rx", capacity=2048),
        PacketOutput("mavlink_tx", capacity=2048),
        Output("position", shape=3, unit="m", description="NED"),
        Output("heard", type=int, description="bytes heard"),
        Output("sequence", type=int),
        Memory("payload", dtype="u1", shape=255),
    )
    kernels = (start, advance)
    errors = {1: "no room"}
'''


def sha(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def prints(out: Path) -> dict[str, str]:
    """Digest of every file of a run but the manifest, which has wall-clock times."""
    files = [p for p in out.rglob("*") if p.is_file() and p.name != "manifest.json"]
    return {p.relative_to(out).as_posix(): sha(p) for p in files}


# ---- signals ----------------------------------------------------------------------------------


def test_schema_and_values(probes: Any, tmp_path: Path) -> None:
    probes.fmu()
    components = probes.component("a", u=1.0, p=2.0, n=41, s="hü") + probes.component("b", b=True)
    assert simulate(probes.ssd(components, "a/y b/u", stop=1.0), RunOptions(out=tmp_path / "out")).outcome == "done"
    table = pq.read_table(tmp_path / "out" / "signals.parquet")
    kinds = {"y": "double", "m": "int32", "c": "bool", "r": "string", "f": "int32"}
    assert [(field.name, str(field.type)) for field in table.schema] == [
        ("time", "double"),
        *((f"{x}.{name}", kind) for x in "ab" for name, kind in kinds.items()),
    ]
    metadata = {field.name: {k.decode(): v.decode() for k, v in field.metadata.items()} for field in table.schema}
    assert metadata["time"]["unit"] == "s"
    assert metadata["a.y"]["unit"] == "m"
    assert metadata["a.m"]["unit"] == ""
    assert json.loads(metadata["a.f"]["items"]) == {"low": 1, "high": 5}
    assert "items" not in metadata["a.m"]
    assert table.to_pydict() == {
        "time": [0.0, 0.5, 1.0],
        "a.y": [3.0] * 3,
        "a.m": [42] * 3,
        "a.c": [True] * 3,
        "a.r": ["hü!"] * 3,
        "a.f": [1] * 3,
        "b.y": [3.25] * 3,
        "b.m": [1] * 3,
        "b.c": [False] * 3,
        "b.r": ["!"] * 3,
        "b.f": [1] * 3,
    }


def test_more_rows_than_a_block_holds(probes: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cosim_master.stepping.plan._BLOCK_BYTES", 1)  # sixteen rows, the least
    probes.fmu(step=0.01)
    monkeypatch.setattr("cosim_master.results.recording.signals._GROUP_BYTES", 20 * (8 + 4 + 8))
    monkeypatch.setattr("cosim_master.results.recording.signals._GROUP_ROWS", 1)
    simulate(probes.ssd(probes.component("a"), stop=0.5), RunOptions(out=tmp_path / "out", record=["a.y", "a.c"]))
    file = pq.ParquetFile(tmp_path / "out" / "signals.parquet")
    assert [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)] == [20, 20, 11]
    assert file.read()["time"].to_pylist() == [k / 100 for k in range(51)]


@pytest.mark.parametrize(("most", "rows"), [(100, [32, 19]), (25, [25, 25, 1]), (10, [20, 20, 11])])
def test_row_groups_of_wide_tables_have_more_rows_within_a_limit(
    probes: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, most: int, rows: list[int]
) -> None:
    """A row has 20 bytes; 20 rows of it are a row group as others are, `most` rows the largest one."""
    probes.fmu(step=0.01)
    for name, value in (("_GROUP_BYTES", 20 * 20), ("_WIDE_GROUP_BYTES", most * 20), ("_GROUP_ROWS", 32)):
        monkeypatch.setattr(f"cosim_master.results.recording.signals.{name}", value)
    simulate(probes.ssd(probes.component("a"), stop=0.5), RunOptions(out=tmp_path / "out", record=["a.y", "a.c"]))
    file = pq.ParquetFile(tmp_path / "out" / "signals.parquet")
    assert [file.metadata.row_group(i).num_rows for i in range(file.num_row_groups)] == rows
    assert file.read()["time"].to_pylist() == [k / 100 for k in range(51)]


@pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="nothing is compiled")
@pytest.mark.parametrize("copied", [-1, 1 << 20])
def test_logs_are_divided_by_the_kernel_that_a_package_brings(
    chatters: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, copied: int
) -> None:
    """Short blocks are copied, and long ones are the run's own."""
    divide, called = logs.divide, set()

    def call(*arguments: Any) -> None:
        called.add(signature_of(arguments))
        divide(*arguments)

    monkeypatch.setattr(logs, "divide", call)
    monkeypatch.setattr(packet_log, "_COPIED", copied)
    assert simulate(chatters(), RunOptions(out=tmp_path / "out")).outcome == "done"
    assert called == {signature_of(kernels_of_runs()["divide"][1])}


def test_recording_and_reading_import_neither_pandas_nor_messages(chatters: Any, tmp_path: Path) -> None:
    """pyarrow imports pandas for types that it does not know to be numpy's: a fifth of a second for nothing. Kernels
    for all messages of MAVLink are for runs with ground stations.
    """
    program = (
        "import sys; from pathlib import Path; from cosim_master.execution.simulate import simulate;"
        "from cosim_master.execution.options import RunOptions;"
        "done = simulate(Path(sys.argv[1]), RunOptions(out=Path(sys.argv[2]))); assert done.outcome == 'done', done;"
        "assert not {'pandas', 'cosim.messages'} & {*sys.modules}"
    )
    out = tmp_path / "out"
    subprocess.run([sys.executable, "-c", program, str(chatters()), str(out)], check=True, timeout=600)
    assert json.loads((out / "manifest.json").read_text())["links"]["count"] > 0


def test_an_interval_and_patterns_from_the_system(probes: Any, tmp_path: Path) -> None:
    probes.fmu(step=0.1)
    text = '<recording xmlns="https://uav-cosim.org/ns/1" interval="0.3" signals="a.? b.y"/>'
    annotation = probes.workshop.annotation("org.uav-cosim.recording", text)
    system = probes.ssd(probes.component("a") + probes.component("b"), stop=1.0, after=annotation)
    simulate(system, RunOptions(out=tmp_path / "out"))
    got = pq.read_table(tmp_path / "out" / "signals.parquet").to_pydict()
    assert got["time"] == [0.0, 0.3, 0.6, 0.9, 1.0]  # and the end of the run
    assert list(got) == ["time", "a.y", "a.m", "a.c", "a.r", "a.f", "b.y"]
    simulate(system, RunOptions(out=tmp_path / "other", record=["*.c"]))
    assert list(pq.read_table(tmp_path / "other" / "signals.parquet").to_pydict()) == ["time", "a.c", "b.c"]


def test_an_index_in_a_pattern_is_an_index(chatters: Any, tmp_path: Path) -> None:
    simulate(chatters(), RunOptions(out=tmp_path / "out", record=["*.position[2]"]))
    got = pq.read_table(tmp_path / "out" / "signals.parquet").to_pydict()
    assert {name: values[0] for name, values in got.items()} == {
        "time": 0.0,
        "d1.position[2]": 10.0,
        "d2.position[2]": 20.0,
        "d10.position[2]": 100.0,
    }


# ---- packets ----------------------------------------------------------------------------------


@pytest.fixture
def chatters(probes: Any, tmp_path: Path) -> Any:
    """A system of three chattering drones, d1, d2 and d10, over a bad channel."""
    sys.modules.pop("chatter", None)
    model(tmp_path, "chatter.py", CHATTER)

    def make(order: tuple[int, ...] = (1, 2, 10), attributes: str = "", stop: float = 0.3, name: str = "s.ssd") -> Path:
        workshop = probes.workshop
        parts = "".join(
            workshop.component(f"d{i}", "Chatter.fmu", "", workshop.bindings({"id": i, "east": 10.0 * i}))
            for i in order
        )
        channel = 'latency="0.015" jitter="0.02" loss="0.25" seed="3" position="position"'
        text = f'<network xmlns="https://uav-cosim.org/ns/1" {channel} {attributes}/>'
        annotation = workshop.annotation("org.uav-cosim.network", text)
        made: Path = probes.ssd(parts, stop=stop, after=annotation, name=name)
        return made

    return make


def replayed(tlog: Path) -> list[tuple[float, int, int, bytes]]:
    """A .tlog as pymavlink replays it: time after the epoch in s, system, sequence number, bytes."""
    connection = mavutil.mavlink_connection(str(tlog), dialect="ardupilotmega")
    found = []
    while (message := connection.recv_msg()) is not None:
        time = round(message._timestamp - EPOCH / 1e6, 6)
        found.append((time, message.get_srcSystem(), message.get_seq(), bytes(message.get_msgbuf())))
    connection.close()
    return found


def test_packets_are_recorded_as_they_went(chatters: Any, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = simulate(chatters(), RunOptions(out=out))
    assert result.outcome == "done", result.error
    events = pq.read_table(out / "packets.parquet").to_pylist()
    assert set(events[0]) == {
        *("sent", "arrival", "source", "target", "message", "system", "component", "sequence", "length", "outcome")
    }
    assert len(events) == 30 * 2 * 3 * 2  # steps, packets, senders, hearers
    assert Counter(e["outcome"] for e in events) == {
        "radio": result.packets["sent"] - result.packets["lost"],
        "lost: channel": result.packets["lost: channel"],
    }
    assert all((e["arrival"] is None) == (e["outcome"] != "radio") for e in events)
    assert all(0.015 <= e["arrival"] - e["sent"] < 0.035 + 1e-12 for e in events if e["arrival"] is not None)
    assert {(e["message"], e["component"], e["length"]) for e in events} == {(0, 1, 21)}
    assert {(e["source"], e["system"]) for e in events} == {("d1", 1), ("d2", 2), ("d10", 10)}

    sent = replayed(out / "packets.tlog")
    assert len(sent) == 30 * 2 * 3
    assert [time for time, *_ in sent] == sorted(time for time, *_ in sent)
    told = Counter((e["sent"], e["system"], e["sequence"]) for e in events)
    assert Counter({(time, system, sequence): 2 for time, system, sequence, _ in sent}) == told

    for node, number in (("d1", 1), ("d2", 2), ("d10", 10)):
        log = replayed(out / "packets" / f"{node}.tlog")
        assert [(t, s, q) for t, s, q, _ in log if s == number] == [(t, s, q) for t, s, q, _ in sent if s == number]
        heard = [(t, s, q) for t, s, q, _ in log if s != number]
        # Read by the step that begins at or after arrival; what arrives later than the last step is not read.
        expected = [
            (-(-round(e["arrival"] * 1e9) // 10_000_000) / 100, e["system"], e["sequence"])
            for e in sorted((e for e in events if e["target"] == node and e["arrival"]), key=lambda e: e["arrival"])
        ]
        assert heard == [row for row in expected if row[0] <= 0.29]


def test_counts_of_result_manifest_and_files_agree(chatters: Any, tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = simulate(chatters(), RunOptions(out=out))
    counts = dict(result.packets)
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["packets"] == counts
    assert counts["sent"] == counts["delivered"] + counts["lost"] + counts["in flight"]
    assert counts["lost"] == sum(n for name, n in counts.items() if name.startswith("lost: "))
    heard = sum(
        s != int(node[1:]) for node in ("d1", "d2", "d10") for _, s, *_ in replayed(out / "packets" / f"{node}.tlog")
    )
    assert heard == counts["delivered"]
    signals = pq.read_table(out / "signals.parquet").to_pydict()
    assert sum(signals[f"{node}.heard"][-1] for node in ("d1", "d2", "d10")) == 21 * counts["delivered"]


def test_without_packets(chatters: Any, tmp_path: Path) -> None:
    """Also over the results of a run with them: nothing old stays behind."""
    system, out = chatters(), tmp_path / "out"
    simulate(system, RunOptions(out=out))
    assert (out / "packets" / "d10.tlog").exists()
    text = '<recording xmlns="https://uav-cosim.org/ns/1" packets="false"/>'
    text = f'<ssc:Annotation type="org.uav-cosim.recording">{text}</ssc:Annotation>'
    system.write_text(system.read_text().replace("</ssd:Annotations>", text + "</ssd:Annotations>"))
    result = simulate(system, RunOptions(out=out))
    assert result.packets["sent"] == 360
    assert sorted(p.name for p in out.rglob("*") if p.is_file()) == ["manifest.json", "signals.parquet"]


def test_a_name_that_is_too_long_for_a_file() -> None:
    """Its beginning remains, whole characters, with a digest by which it differs from others."""
    name = "\N{GRINNING FACE}" * 200
    assert file_name(name[:50]) == name[:50] and file_name("..") == "%2E%2E"
    assert file_name(name) == name[:37] + "~" + hashlib.sha256(name.encode()).hexdigest()[:16]
    assert file_name(name + "a") != file_name(name + "b")


def test_names_of_nodes_are_made_names_of_files(probes: Any, tmp_path: Path, chatters: Any) -> None:
    system = chatters()
    system.write_text(system.read_text().replace('name="d10"', 'name="x/y: 50%"'))
    assert simulate(system, RunOptions(out=tmp_path / "out")).outcome == "done"
    names = sorted(p.name for p in (tmp_path / "out" / "packets").iterdir())
    assert names == ["d1.tlog", "d2.tlog", "x%2Fy%3A 50%25.tlog"]


# ---- repeatable -------------------------------------------------------------------------------


def test_the_same_run_twice_gives_the_same_bytes(chatters: Any, tmp_path: Path) -> None:
    for out in ("one", "two"):
        simulate(chatters(), RunOptions(out=tmp_path / out))
    assert prints(tmp_path / "one") == prints(tmp_path / "two")
    assert set(prints(tmp_path / "one")) == {
        *("signals.parquet", "packets.parquet", "packets.tlog"),
        *(f"packets/d{i}.tlog" for i in (1, 2, 10)),
    }


def test_another_order_of_components_gives_the_same_bytes(chatters: Any, tmp_path: Path) -> None:
    simulate(chatters(), RunOptions(out=tmp_path / "one"))
    simulate(chatters((10, 1, 2), name="other.ssd"), RunOptions(out=tmp_path / "two"))
    assert prints(tmp_path / "one") == prints(tmp_path / "two")


def test_looking_at_a_run_does_not_change_it(chatters: Any, tmp_path: Path) -> None:
    """Nor does a pace, which makes other chunks of steps."""
    simulate(chatters(), RunOptions(out=tmp_path / "one"))
    simulate(chatters(), RunOptions(out=tmp_path / "two", pace=3.0), listener=Listener(progress=lambda _: None))
    assert prints(tmp_path / "one") == prints(tmp_path / "two")


def test_another_seed_gives_other_packets(chatters: Any, tmp_path: Path) -> None:
    simulate(chatters(), RunOptions(out=tmp_path / "one"))
    simulate(chatters(), RunOptions(out=tmp_path / "two", seed=4))
    one, two = prints(tmp_path / "one"), prints(tmp_path / "two")
    assert one["packets.tlog"] == two["packets.tlog"]
    assert one["packets.parquet"] != two["packets.parquet"]


# ---- manifest ---------------------------------------------------------------------------------


def test_manifest(probes: Any, tmp_path: Path) -> None:
    fmu = probes.fmu()
    components = probes.component("a", p=1.5) + probes.component("b", after=probes.step(1.0))
    system = probes.ssd(components, stop=2.0)
    result = simulate(system, RunOptions(out=tmp_path / "out", overrides={"b.when": "INF", "b.p": "0.5"}))
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert (manifest["outcome"], manifest["error"], manifest["simulated_s"]) == ("done", None, 2.0)
    assert manifest["wall_s"] == result.wall_s
    assert manifest["real_time_factor"] == 2.0 / result.wall_s
    assert manifest["system"] == {"name": "test", "path": str(system), "sha256": sha(system)}
    assert (manifest["start_time"], manifest["base_step"], manifest["seed"]) == (0.0, 0.5, 0)
    assert manifest["fmus"] == {str(fmu): {"sha256": sha(fmu), "guid": "probe", "model": "Unit", "verdicts": {}}}
    assigned = {name: one.pop("assigned") for name, one in manifest["instances"].items()}
    assert assigned["a"] == {"p": {"name": "p", "text": "1.5", "where": assigned["a"]["p"]["where"]}}
    assert assigned["a"]["p"]["where"].startswith(f"{system}:")
    assert assigned["b"] == {
        "when": {"name": "b.when", "text": "inf", "where": "--set"},
        "p": {"name": "b.p", "text": "0.5", "where": "--set"},
    }
    assert manifest["instances"] == {
        "a": {"fmu": str(fmu), "step": 0.5, "step_by": "FMU", "parameters": {"p": 1.5, "mode": 0, "when": 0.0}},
        "b": {"fmu": str(fmu), "step": 1.0, "step_by": "system", "parameters": {"p": 0.5, "mode": 0, "when": "INF"}},
    }
    assert set(manifest["versions"]) == {"python", "uav-cosim", "numba", "numpy", "pyarrow", "fmpy"}
    assert manifest["notes"] == list(result.notes)


def test_a_run_that_breaks_off_leaves_its_rows_and_no_old_manifest(probes: Any, tmp_path: Path) -> None:
    probes.fmu()
    out = tmp_path / "out"
    simulate(probes.ssd(probes.component("a")), RunOptions(out=out))
    assert (out / "manifest.json").exists()

    def break_off(_: Any) -> None:
        raise RuntimeError("power cut")

    with pytest.raises(RuntimeError, match="power cut"):
        simulate(probes.ssd(probes.component("a")), RunOptions(out=out), listener=Listener(progress=break_off))
    assert json.loads((out / "manifest.json").read_text())["outcome"] == "running"
    assert not goes_on(out)
    assert signals(out)["time"].to_pylist()[0] == 0.0
    assert repair(out)["outcome"] == "killed"
    assert pq.read_table(out / "signals.parquet").equals(signals(out))


def test_packets_of_a_killed_run(chatters: Any, tmp_path: Path) -> None:
    system = chatters()
    simulate(system, RunOptions(out=tmp_path / "whole"))
    whole = pq.read_table(tmp_path / "whole" / "packets.parquet")
    cut = broken_off(system, tmp_path / "cut", 0.2)
    before = packets(cut)
    assert 0 < before.num_rows < whole.num_rows
    assert before.equals(whole.slice(0, before.num_rows), check_metadata=True)
    repair(cut)
    assert pq.read_table(cut / "packets.parquet").equals(before, check_metadata=True)
    for log in (cut / "packets.tlog", *cut.glob("packets/*.tlog")):
        assert (tmp_path / "whole" / log.relative_to(cut)).read_bytes().startswith(log.read_bytes())
        assert log.stat().st_size > 100


def test_too_few_descriptors(chatters: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The third log cannot be opened; the message says what to do, and nothing is left behind."""
    opened = []
    real = Path.open

    def counting(self: Path, *of: Any, **options: Any) -> Any:
        if self.suffix == ".tlog":
            opened.append(self)
            if len(opened) > 2:
                raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))
        return real(self, *of, **options)

    system = chatters()
    monkeypatch.setattr(Path, "open", counting)
    with pytest.raises(SystemDescriptionError) as caught:
        simulate(system, RunOptions(out=tmp_path / "out"))
    text = "cannot hold the results of a run: Too many open files; raise the limit of open files (ulimit -n)"
    assert str(caught.value) == f"{tmp_path / 'out'}: {text}"
    assert not (tmp_path / "out" / "unfinished").exists()
    assert not (tmp_path / "out" / "manifest.json").exists()


def test_a_journal_that_cannot_end_its_group_loses_nothing(
    chatters: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the end of the run, as when the disk fills just then: the files of the finished run hold all rows."""
    system = chatters()
    assert simulate(system, RunOptions(out=tmp_path / "good")).outcome == "done"

    def full(journal: Journal, what: str, end: Callable[[Journal, str], None] = Journal.end_group) -> None:
        if (tmp_path / "out" / "unfinished" / "begun").exists():
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        end(journal, what)

    monkeypatch.setattr(Journal, "end_group", full)

    class Marks:
        every = 1

        def initialised(self, seen: Seen) -> None:
            (tmp_path / "out" / "unfinished" / "begun").touch()

        def stepped(self, seen: Seen) -> None: ...
        def closed(self) -> None: ...

    assert simulate(system, RunOptions(out=tmp_path / "out"), observers=[lambda _: Marks()]).verdict
    for name in ("signals.parquet", "packets.parquet"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "good" / name).read_bytes()
