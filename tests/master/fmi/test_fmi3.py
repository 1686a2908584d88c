"""FMI 3.0 instances in a run: all types, arrays, Binary, and ways to fail. The FMU checks each call (strict3.c)."""

from __future__ import annotations

import json
import os
import zipfile
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from cosim_master.diagnostics.errors import FmuError, SystemDescriptionError
from cosim_master.execution.execution import Execution
from cosim_master.execution.options import RunOptions
from cosim_master.execution.outcome.result import RunResult
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.description.read import describe
from cosim_master.fmi.slaves.fmi3 import Instance3
from cosim_master.fmi.slaves.libraries import Libraries
from cosim_master.stepping.layout import make_layout
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from cosim_master.system.settings.network import network_of
from cosim_master.system.settings.time_grid import time_grid
from tests.master.fmus.probe import compiled
from tests.master.fmus.strict3 import ABLE, SHORT, description

pytestmark = pytest.mark.usefixtures("own_cache")
ARRAYS = tuple(SHORT.values())
SCALARS = ("s", "d", "e")
ALL = " ".join(f"{name}_in:input {name}_out:output" for name in (*ARRAYS, *SCALARS))


def signals(out: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = pq.read_table(out / "signals.parquet").to_pydict()
    return found


def ran(stricts3: Any, system: Path, **options: Any) -> RunResult:
    result = simulate(system, RunOptions(**options))
    assert stricts3.complaints == []
    return result


def failed(stricts3: Any, parts: str, **options: Any) -> str:
    result = ran(stricts3, stricts3.ssd(parts), **options)
    assert result.outcome == "failed"
    return str(result.error)


# ---- types ---------------------------------------------------------------------------------------------------------


def test_every_type_flows(stricts3: Any, tmp_path: Path) -> None:
    """a's inputs are start values; b gets a's outputs, whole arrays by one connection; b adds 1 again."""
    stricts3.fmu()
    given: dict[str, Any] = {f"{name}_in[{i}]": 10 * i for name in ARRAYS if name[0] in "iu" for i in (1, 2)}
    given |= {"f32_in[1]": 0.5, "f32_in[2]": -2.25, "f64_in[1]": 0.1, "f64_in[2]": 1e300}
    given |= {"b_in[1]": True, "b_in[2]": False, "s_in": "grüß", "e_in": 5}
    parts = stricts3.component("a", ports=ALL, **given) + stricts3.component("b", ports=ALL)
    wires = [f"a/{name}_out b/{name}_in" for name in (*ARRAYS, *SCALARS)]
    result = ran(stricts3, stricts3.ssd(parts, *wires, stop=1.0), out=tmp_path / "out")
    assert result.outcome == "done", result.error
    got = signals(tmp_path / "out")
    for name in ARRAYS:
        if name[0] in "iu":
            assert [got[f"b.{name}_out[{i}]"] for i in (1, 2)] == [[12] * 3, [22] * 3], name
    assert got["b.f32_out[1]"] == [2.5] * 3
    assert got["b.f32_out[2]"] == [-0.25] * 3
    assert got["b.f64_out[1]"] == [0.1 + 1 + 1] * 3
    assert got["b.f64_out[2]"] == [1e300] * 3
    assert got["b.b_out[1]"] == [True] * 3
    assert got["b.b_out[2]"] == [False] * 3
    assert got["b.s_out"] == ["grüß"] * 3
    assert got["b.e_out"] == [5] * 3


def test_single_precision_is_rounded_once(stricts3: Any, tmp_path: Path) -> None:
    stricts3.fmu()
    parts = stricts3.component("a", **{"f32_in[1]": 0.1})
    ran(stricts3, stricts3.ssd(parts, stop=0.5), out=tmp_path / "out")
    (first, _) = signals(tmp_path / "out")["a.f32_out[1]"]
    assert first == pytest.approx(1.1, rel=1e-7)
    assert first != 1.1


def test_elements_that_are_not_connected_keep_their_start_value(stricts3: Any, tmp_path: Path) -> None:
    stricts3.fmu()
    ports = "f64_in[1]:input f64_in[2]:input i8_in[2]:input f64_out[1]:output i8_out[1]:output"
    parts = stricts3.component("a", ports=ports, **{"f64_in[1]": 5.0, "i8_in[1]": 3})
    parts += stricts3.component("b", ports=ports, **{"f64_in[1]": 7.0, "i8_in[1]": 9})
    system = stricts3.ssd(parts, "a/f64_out[1] b/f64_in[2]", "a/i8_out[1] b/i8_in[2]", stop=1.0)
    ran(stricts3, system, out=tmp_path / "out")
    got = signals(tmp_path / "out")
    assert [got[f"b.f64_out[{i}]"][-1] for i in (1, 2)] == [8.0, 7.0]
    assert [got[f"b.i8_out[{i}]"][-1] for i in (1, 2)] == [10, 5]


def test_binary_is_copied_byte_for_byte(stricts3: Any) -> None:
    """Zeros and bytes that are no text; zero bytes are no message (pitfall 32)."""
    with Libraries() as libraries:
        fmu = describe(stricts3.fmu())
        one = Instance3(libraries.load(fmu), "one")
        v = fmu.variables
        for data in ("", "00ff00fe", "80" * 64):
            one.set([v["d_in"], v["u64_in[2]"]], [data, 17])
            if one.time is None:
                one.setup_experiment(0.0, 1.0)
                one.enter_initialization_mode()
            assert one.get([v["d_out"], v["u64_out[2]"], v["u64_out[1]"], v["b_out[1]"]]) == [data, 18, 1, False]
        one.exit_initialization_mode()
        one.terminate()
        one.terminate()
        one.free()
        one.free()
    assert stricts3.complaints == []


def test_integers_that_do_not_fit(stricts3: Any) -> None:
    stricts3.fmu()
    with pytest.raises(SystemDescriptionError, match=r'"u8_in\[1\]" is set to 256, which does not fit into UInt8'):
        ran(stricts3, stricts3.ssd(stricts3.component("a", **{"u8_in[1]": 256})))
    error = failed(stricts3, stricts3.component("a", mode=7, when=0.5))
    assert "a: fmi3GetInt64 failed at t = 0 s: an integer does not fit" in error


WIDE = {"i64": (-(2**62) - 1, "int64"), "u64": (2**64 - 5, "uint64"), "u32": (2**32 - 9, "uint32")}


@pytest.mark.parametrize("name", list(WIDE))
def test_integers_of_64_bits_are_carried_exactly(stricts3: Any, tmp_path: Path, name: str) -> None:
    """As start values, through connections, in results, and when they are changed during a run."""
    stricts3.fmu()
    value, kind = WIDE[name]
    whole = f"{name}_in:input {name}_out:output"
    parts = stricts3.component("a", ports=whole) + stricts3.component("b", ports=whole)
    parts += stricts3.component("c")
    system = stricts3.ssd(parts, f"a/{name}_out b/{name}_in", stop=2.0)
    starts = {f"a.{name}_in[1]": str(value), f"a.{name}_in[2]": "7", f"c.{name}_in[1]": str(value - 1)}
    ran(stricts3, system, out=tmp_path / "out", overrides=starts, at=[(1.0, f"a.{name}_in[2]", str(value + 1))])
    got = signals(tmp_path / "out")
    assert str(pq.read_schema(tmp_path / "out" / "signals.parquet").field(f"b.{name}_out[1]").type) == kind
    assert got[f"a.{name}_out[1]"] == [value + 1] * 5
    assert got[f"b.{name}_out[1]"] == [value + 2] * 5
    assert got[f"a.{name}_out[2]"] == [8, 8, 8, value + 2, value + 2]
    assert got[f"b.{name}_out[2]"] == [9, 9, 9, 9, value + 3]
    assert got[f"c.{name}_out[1]"] == [value] * 5


def test_an_element_of_64_bits_that_is_not_connected_keeps_its_value(stricts3: Any, tmp_path: Path) -> None:
    stricts3.fmu()
    ports = "i64_in[1]:input i64_in[2]:input i64_out[1]:output"
    parts = stricts3.component("a", ports=ports) + stricts3.component("b", ports=ports)
    starts = {"a.i64_in[1]": str(2**40), "b.i64_in[2]": str(-(2**50))}
    ran(stricts3, stricts3.ssd(parts, "a/i64_out[1] b/i64_in[1]", stop=1.0), out=tmp_path / "out", overrides=starts)
    got = signals(tmp_path / "out")
    assert [got[f"b.i64_out[{i}]"][-1] for i in (1, 2)] == [2**40 + 2, 1 - 2**50]


def test_integers_are_widened(stricts3: Any, tmp_path: Path) -> None:
    """With their sign into 64 bits; UInt32 goes into a Real, whole."""
    stricts3.fmu()
    ports = "i32_out[1]:output u32_out[1]:output i64_in[1]:input u64_in[1]:input f64_in[1]:input u8_out[1]:output"
    parts = stricts3.component("a", ports=ports) + stricts3.component("b", ports=ports)
    wires = ("a/i32_out[1] b/i64_in[1]", "a/u32_out[1] b/f64_in[1]", "a/u8_out[1] b/u64_in[1]")
    starts = {"a.i32_in[1]": "-41", "a.u32_in[1]": str(2**32 - 2), "a.u8_in[1]": "254"}
    ran(stricts3, stricts3.ssd(parts, *wires, stop=1.0), out=tmp_path / "out", overrides=starts)
    got = signals(tmp_path / "out")
    assert got["b.i64_out[1]"] == [-39] * 3
    assert got["b.f64_out[1]"] == [2.0**32] * 3
    assert got["b.u64_out[1]"] == [256] * 3


def test_integers_of_64_bits_are_mapped(stricts3: Any, tmp_path: Path) -> None:
    stricts3.fmu()
    parts = "".join(stricts3.component(n, ports="i64_in[1]:input i64_out[1]:output") for n in "abc")
    key, to = 1001, -5
    table = f'<ssc:MapEntry source="{key}" target="{to}"/>'
    inner = f"<ssc:IntegerMappingTransformation>{table}</ssc:IntegerMappingTransformation>"
    workshop = stricts3.workshop
    wires = "".join(workshop.connection("a/i64_out[1]", f"{n}/i64_in[1]", inner) for n in "bc")
    experiment = '<ssd:DefaultExperiment startTime="0" stopTime="1"/>'
    system = workshop.ssd("m.ssd", workshop.system(parts, wires), experiment)
    for start, expected in ((key - 1, to + 1), (1, 3), (2**40 + key - 1, 2**40 + key + 1)):
        ran(stricts3, system, out=tmp_path / "out", overrides={"a.i64_in[1]": str(start)})
        got = signals(tmp_path / "out")
        assert got["b.i64_out[1]"] == got["c.i64_out[1]"] == [expected] * 3


def test_an_integer_that_does_not_fit_into_an_instance(stricts3: Any) -> None:
    with Libraries() as libraries:
        fmu = describe(stricts3.fmu())
        one = Instance3(libraries.load(fmu), "one")
        with pytest.raises(FmuError, match=r"i8_in\[1\] = 128 does not fit into Int8"):
            one.set([fmu.variables["i8_in[1]"]], [128])
        one.free()


def test_connections_to_narrower_types_are_refused(stricts3: Any, tmp_path: Path) -> None:
    stricts3.fmu()
    ports = "i32_out[1]:output i8_in[1]:input i8_out[1]:output i32_in[1]:input"
    parts = stricts3.component("a", ports=ports, **{"i8_in[1]": 5}) + stricts3.component("b", ports=ports)
    with pytest.raises(SystemDescriptionError, match=r"a\.i32_out\[1\] is Integer and b\.i8_in\[1\] is Int8"):
        ran(stricts3, stricts3.ssd(parts, "a/i32_out[1] b/i8_in[1]"))
    ran(stricts3, stricts3.ssd(parts, "a/i8_out[1] b/i32_in[1]"), out=tmp_path / "out")
    assert signals(tmp_path / "out")["b.i32_out[1]"][-1] == 7


def test_no_intermediate_variables_without_a_callback(stricts3: Any) -> None:
    """Pitfall 34: intermediateUpdate is NULL, so there must be no required intermediate variables, even where an FMU
    could take some; the user is told that its inputs keep their values over each step.
    """
    path = stricts3.fmu(flags=f'{ABLE} providesIntermediateUpdate="true" canReturnEarlyAfterIntermediateUpdate="true"')
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    text = members["modelDescription.xml"].decode()
    text = text.replace('causality="input"', 'causality="input" intermediateUpdate="true"')
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in (members | {"modelDescription.xml": text.encode()}).items():
            archive.writestr(name, content)
    (note,) = describe(path).notes
    assert note == (
        'its inputs "f32_in", "f64_in", "i8_in" and 11 more could get new values in the middle of a step '
        "(intermediateUpdate); they keep theirs over each step"
    )
    assert ran(stricts3, stricts3.ssd(stricts3.component("a"), stop=1.0)).outcome == "done"


def test_resource_paths(stricts3: Any) -> None:
    """With a separator at the end (the strict FMU looks), or NULL where there are none."""
    stricts3.fmu()
    ran(stricts3, stricts3.ssd(stricts3.component("a"), stop=0.5))
    assert stricts3.calls[0] == "a: instantiated without resources 0"
    stricts3.fmu(resources=True)
    ran(stricts3, stricts3.ssd(stricts3.component("a"), stop=0.5))
    assert stricts3.calls[0] == "a: instantiated with resources 0"


@pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="profiles need compiled kernels")
def test_a_profile_counts_the_steps(stricts3: Any, tmp_path: Path) -> None:
    stricts3.fmu()
    parts = stricts3.component("a", ports=ALL) + stricts3.component("b", ports=ALL)
    system = stricts3.ssd(parts, "a/f32_out b/f32_in", "a/i8_out b/i8_in", stop=2.0)
    profiled = ran(stricts3, system, out=tmp_path / "with", profile=True)
    assert profiled.profile is not None
    (spent,) = profiled.profile.fmus
    assert (spent.instances, spent.steps) == (2, 8)
    ran(stricts3, system, out=tmp_path / "without")
    assert signals(tmp_path / "with") == signals(tmp_path / "without")


# ---- steps that are not as they should be ---------------------------------------------------------------------------


@pytest.mark.parametrize(("mode", "word"), [(2, "fmi3Error"), (3, "fmi3Fatal")])
def test_errors(stricts3: Any, mode: int, word: str) -> None:
    """Pitfall 30: after fmi3Error the FMU is terminated and may only be freed, after fmi3Fatal not even that. Only what
    is allowed is called (the strict FMU looks), and its log is in the message.
    """
    stricts3.fmu()
    error = failed(stricts3, stricts3.component("a", mode=mode, when=1.0) + stricts3.component("b"))
    assert "a: fmi3DoStep" in error and word in error and "it is over" in error
    assert ("b: terminate 1.5" in stricts3.calls) == (mode == 2)


def test_a_discarded_step_is_repeated_shorter(stricts3: Any, tmp_path: Path) -> None:
    """Pitfall 30: fmi3Discard has changed nothing, other than fmi2Discard, and how far it got is not asked for."""
    stricts3.fmu()
    parts = stricts3.component("a", mode=1, when=0.5, longest=0.25)
    result = ran(stricts3, stricts3.ssd(parts, stop=1.0), out=tmp_path / "out")
    assert result.outcome == "done", result.error
    assert [call for call in stricts3.calls if "step" in call][-2:] == ["a: step 0.25"] * 2


def test_a_discarded_step_that_cannot_be_repeated(stricts3: Any) -> None:
    stricts3.fmu(flags="")
    error = failed(stricts3, stricts3.component("a", mode=1, when=0.5, longest=0.25))
    assert "fmi3Discard: it could not step from 0.5 s to 1 s; canGetAndSetFMUstate of a is false" in error


def test_an_fmu_ends_the_run(stricts3: Any) -> None:
    stricts3.fmu()
    result = ran(stricts3, stricts3.ssd(stricts3.component("a", mode=4, when=1.0)))
    assert result.outcome == "terminated"
    assert "a: it requested the end of the run at t = 1.5 s (terminateSimulation)" in str(result.error)


def test_an_fmu_ends_the_run_while_another_discards(stricts3: Any) -> None:
    """The end is no failure, and takes the step with it."""
    stricts3.fmu()
    parts = stricts3.component("a", mode=4, when=1.0) + stricts3.component("b", mode=1, when=1.0, longest=0.25)
    result = ran(stricts3, stricts3.ssd(parts))
    assert (result.outcome, result.simulated_s) == ("terminated", 1.0)
    assert "a: it requested the end of the run at t = 1.5 s (terminateSimulation)" in str(result.error)


def test_terminate_that_fails_leaves_a_complete_recording(stricts3: Any, tmp_path: Path) -> None:
    stricts3.fmu()
    parts = stricts3.component("a", mode=20) + stricts3.component("b")
    result = ran(stricts3, stricts3.ssd(parts, stop=1.0), out=tmp_path / "out")
    assert (result.outcome, result.simulated_s) == ("failed", 1.0)
    assert str(result.error) == "a: fmi3Terminate failed at t = 1 s: fmi3Error"
    assert signals(tmp_path / "out")["time"] == [0.0, 0.5, 1.0]
    assert json.loads((tmp_path / "out" / "manifest.json").read_text())["outcome"] == "failed"
    assert [call for call in stricts3.calls if "terminate" in call] == ["a: terminate 1", "b: terminate 1"]


def test_early_return_that_was_not_allowed(stricts3: Any) -> None:
    stricts3.fmu()
    error = failed(stricts3, stricts3.component("a", mode=5, when=0.5))
    assert "it has not simulated all of the step, though early return is not allowed" in error


def test_outputs_that_are_no_numbers(stricts3: Any) -> None:
    stricts3.fmu()
    error = failed(stricts3, stricts3.component("a", mode=6, when=1.0))
    assert "a: fmi3GetFloat64 failed at t = 0.5 s: f64_out[2] is not a number" in error


@pytest.mark.parametrize("mode", [8, 9])
def test_warnings_and_times_a_little_short_are_no_failures(stricts3: Any, mode: int) -> None:
    """Pitfall 29: lastSuccessfulTime may differ from t + h without early return."""
    stricts3.fmu()
    assert ran(stricts3, stricts3.ssd(stricts3.component("a", mode=mode, when=0.5))).outcome == "done"


# ---- descriptions ---------------------------------------------------------------------------------------------------


def test_an_array_is_one_variable_per_element(stricts3: Any) -> None:
    fmu = describe(stricts3.fmu())
    assert fmu.notes == ()
    assert fmu.shapes["i16_in"] == (2,)
    assert [fmu.variables[f"i16_in[{i}]"].element for i in (1, 2)] == [0, 1]
    assert fmu.outputs["i16_out[2]"] == ("i16_in[1]", "i16_in[2]")
    assert fmu.variables["e_in"].items == {"low": 1, "high": 5}
    assert fmu.variables["d_in"].mime_type == "application/x-test"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('<Dimension start="2"/>', '<Dimension valueReference="40"/>', "neither a size nor a structural parameter"),
        ('<Dimension start="2"/>', '<Dimension start="2000000"/>', "has 2000000 elements; at most 1048576"),
        ('start="0"><Dim', 'start="0 1 2"><Dim', "has 2 elements and 3 start values"),
        ('start="false"', 'start="maybe"', 'start "maybe" of "b_in" is not of type Boolean'),
        ('name="high" value="5"', 'name="high"', 'item "high" of the Enumeration "e_in" needs an integer value'),
        ("<CoSimulation modelId", "<ScheduledExecution modelId", "Scheduled Execution only"),
    ],
)
def test_descriptions_that_are_wrong(stricts3: Any, old: str, new: str, message: str) -> None:
    text = description()
    assert old in text
    path = stricts3.workshop.pack("wrong.fmu", text.replace(old, new))
    with pytest.raises(SystemDescriptionError, match=message):
        describe(path)


def test_array_connectors_must_have_the_dimensions_of_the_fmu(stricts3: Any) -> None:
    stricts3.fmu()
    system = stricts3.ssd(stricts3.component("a", ports="i8_in:input"))
    text = system.read_text().replace(
        '<ssd:Connector name="i8_in" kind="input">',
        '<ssd:Connector name="i8_in" kind="input"><ssc:Integer/><ssc:Dimension size="3"/>',
    )
    system.write_text(text.replace('version="1.0" name="test"', 'version="2.0" name="test"'))
    with pytest.raises(SystemDescriptionError, match=r"has other dimensions than in strict3\.fmu: 2"):
        simulate(system)


# ---- packets between FMI 2 and FMI 3 --------------------------------------------------------------------------------


SENT = {"a.d_in": "00fdff80"}


@pytest.fixture
def packets(stricts: Any, stricts3: Any, tmp_path: Path) -> Any:
    """Component d3 with Binary packet ports, quiet.fmu and loud.fmu with String ones: r is s (and "!")."""
    ours = 'mimeType="application/x-mavlink" maxSize="300"'
    text = description().replace('mimeType="application/x-test" maxSize="64"', ours)
    path = stricts3.fmu("d3.fmu")
    rewritten(path, lambda _: text)
    source = tmp_path / "quiet.c"
    source.write_text((Path(__file__).parents[1] / "fmus" / "strict.c").read_text().replace('"%s!"', '"%s"'))
    tool = '<VendorAnnotations><Tool name="uav-cosim"><PacketPorts>'
    tool += "".join(f'<PacketPort variable="{name}" maxSize="300"/>' for name in "sr")
    tool += "</PacketPorts></Tool></VendorAnnotations>"
    for name, library in (("loud.fmu", None), ("quiet.fmu", compiled(source, tmp_path))):
        path = stricts.fmu(name)
        rewritten(path, lambda old: old.replace("<ModelVariables>", f"{tool}<ModelVariables>"), library)
    return stricts3


def rewritten(path: Path, change: Any, library: bytes | None = None) -> None:
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            if name == "modelDescription.xml":
                content = change(content.decode()).encode()
            archive.writestr(name, library or content if name.startswith("binaries") else content)


def wired(packets: Any, fmu: str) -> Path:
    component = packets.workshop.component
    parts = packets.component("a", "d3.fmu", ports="d_out:output")
    parts += component("b", fmu, "s:input:String r:output:String") + component("c", "d3.fmu", "d_in:input d_out:output")
    system: Path = packets.ssd(parts, "a/d_out b/s", "b/r c/d_in", stop=1.0)
    return system


def test_packets_between_a_binary_and_a_string(packets: Any, stricts: Any) -> None:
    """Bytes of FMI 3 are base64 text in FMI 2 where a connection leads from one to the other, and back."""
    with read_system(wired(packets, "quiet.fmu")) as structure:
        checked = check(structure, SENT)
        clock, network = time_grid(checked), network_of(checked)
        with Execution(checked, clock, make_layout(checked, network), network) as execution:
            execution.advance(clock.steps)
            b, c = execution.slaves[1:]
            assert b.get([b.fmu.variables["r"]]) == ["AP3/gA=="]
            assert c.get([c.fmu.variables["d_out"]]) == ["00fdff80"]
    assert packets.complaints == stricts.complaints == []


def test_packets_that_are_not_base64(packets: Any) -> None:
    result = simulate(wired(packets, "loud.fmu"), RunOptions(overrides=SENT))
    assert result.outcome == "failed"
    assert "b: fmi2GetString" in str(result.error) and "its packet output r is not base64 text" in str(result.error)


def test_only_packets_go_from_a_binary_to_a_string(stricts: Any, stricts3: Any) -> None:
    stricts.fmu("b.fmu")
    stricts3.fmu("a.fmu")
    parts = stricts3.component("a", "a.fmu", ports="d_out:output") + stricts3.workshop.component(
        "b", "b.fmu", "s:input"
    )
    with pytest.raises(SystemDescriptionError, match=r"a\.d_out is Binary and b\.s is String"):
        simulate(stricts3.ssd(parts, "a/d_out b/s"))
