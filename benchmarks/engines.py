"""What engines make of small SSPs: ours, FMPy, libcosim, Ecos, and OMSimulator where OMSIMULATOR names its executable.

    python benchmarks/engines.py [--engines NAME ...] [--write docs/engines.md]

Each system has one rule of SSP in it and one number, sink.y after a second of simulated time, that is right only if
the rule is followed. The number is worked out by hand from the standard. Sources are constant, so how an engine
delays values does not matter. Every engine runs every system in a process of its own.
"""

from __future__ import annotations

import argparse
import csv
import ctypes
import math
import os
import re
import subprocess
import sys
import tempfile
import zipfile
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

STEP, STOP = 0.1, 1.0
NOT_RUN = "not run"
_HEAD = (
    'xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription" '
    'xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" '
    'xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" '
    'xmlns:ssm="http://ssp-standard.org/SSP1/SystemStructureParameterMapping" '
    'xmlns:ssb="http://ssp-standard.org/SSP1/SystemStructureSignalDictionary"'
)
_UNITS = (
    "<ssd:Units>"
    '<ssc:Unit name="km"><ssc:BaseUnit m="1" factor="1000"/></ssc:Unit>'
    '<ssc:Unit name="m"><ssc:BaseUnit m="1"/></ssc:Unit>'
    '<ssc:Unit name="degC"><ssc:BaseUnit K="1" offset="273.15"/></ssc:Unit>'
    '<ssc:Unit name="K"><ssc:BaseUnit K="1"/></ssc:Unit>'
    "</ssd:Units>"
)
_ENUMERATIONS = (
    '<ssd:Enumerations><ssc:Enumeration name="Level"><ssc:Item name="low" value="1"/><ssc:Item name="high" value="5"/>'
    "</ssc:Enumeration></ssd:Enumerations>"
)
_TYPES = {
    "u": "Real", "value": "Real", "y": "Real", "k": "Real", "gain": "Real", "length": 'Real unit="m"',
    "temperature": 'Real unit="K"', "far": 'Real unit="km"', "warm": 'Real unit="degC"', "n": "Integer",
    "count": "Integer", "flag": "Boolean", "on": "Boolean", "off": "Boolean",
}  # fmt: skip
_INPUTS = ("u", "length", "temperature", "n", "flag")


@dataclass(frozen=True)
class Case:
    """A system and the number that it gives by the standard."""

    name: str
    section: str
    expected: float
    body: str
    files: dict[str, str] = field(default_factory=dict)
    sink: tuple[int, str, bool] | None = None
    """The sink is an FMU of this version of FMI, with these interfaces ("CS", "ME"), sources instead of a binary."""
    tolerance: float = 1e-9

    def is_right(self, got: float | str) -> bool:
        return isinstance(got, float) and math.isclose(got, self.expected, rel_tol=self.tolerance)


def _connectors(*names: str, typed: bool = True) -> str:
    made = "".join(
        f'<ssd:Connector name="{n}" kind="{"input" if n in _INPUTS else "output"}">'
        + (f"<ssc:{_TYPES[n]}/>" if typed else "")
        + "</ssd:Connector>"
        for n in names
    )
    return f"<ssd:Connectors>{made}</ssd:Connectors>"


def _component(name: str, *connectors: str, bindings: str = "", typed: bool = True) -> str:
    head = f'<ssd:Component name="{name}" type="application/x-fmu-sharedlibrary" source="resources/Switchboard.fmu">'
    return f"{head}{_connectors(*connectors, typed=typed)}{bindings}</ssd:Component>"


def _parameters(values: dict[str, str]) -> str:
    """Values by name; an item of the enumeration where it is no number."""
    return "".join(
        f'<ssv:Parameter name="{n}"><ssv:{"Real" if v[0].isdigit() else "Enumeration"} value="{v}"/></ssv:Parameter>'
        for n, v in values.items()
    )


def _set(values: dict[str, str], head: str = "") -> str:
    return (
        f'<ssv:ParameterSet {head} version="1.0" name="set"><ssv:Parameters>{_parameters(values)}</ssv:Parameters>'
        "</ssv:ParameterSet>"
    )


def _bound(*sets: dict[str, str]) -> str:
    made = "".join(
        f"<ssd:ParameterBinding><ssd:ParameterValues>{_set(values)}</ssd:ParameterValues></ssd:ParameterBinding>"
        for values in sets
    )
    return f"<ssd:ParameterBindings>{made}</ssd:ParameterBindings>"


def _wire(start: str, end: str, inner: str = "") -> str:
    ends = ""
    for side, text in (("start", start), ("end", end)):
        element, _, connector = text.rpartition(".")
        ends += f' {side}Element="{element}"' if element else ""
        ends += f' {side}Connector="{connector}"'
    return f"<ssd:Connection{ends}>{inner}</ssd:Connection>"


def _system(elements: str, connections: str, bindings: str = "", after: str = "") -> str:
    return (
        f'<ssd:System name="root">{bindings}<ssd:Elements>{elements}</ssd:Elements>'
        f"<ssd:Connections>{connections}</ssd:Connections>{after}</ssd:System>"
    )


def _pair(source: str, sink: str, inner: str = "", *, of_source: str = "", of_sink: str = "", outer: str = "") -> str:
    """source -> sink, one connection."""
    elements = _component("source", source, bindings=of_source) + _component("sink", sink, "y", bindings=of_sink)
    return _system(elements, _wire(f"source.{source}", f"sink.{sink}", inner), outer)


def cases() -> list[Case]:
    ssv = f'<?xml version="1.0" encoding="UTF-8"?>\n{_set({"k": "5"}, _HEAD)}'
    other = f'<?xml version="1.0" encoding="UTF-8"?>\n{_set({"height": "4"}, _HEAD)}'
    ssm = (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<ssm:ParameterMapping {_HEAD} version="1.0">'
        '<ssm:MappingEntry source="height" target="k"/></ssm:ParameterMapping>'
    )
    gap = ssm.replace("<ssm:MappingEntry", '<ssm:MappingEntry source="" target="gain"/><ssm:MappingEntry')
    distance = (
        _bound({"length": "3"})
        .replace('value="3"', 'value="3" unit="km"')
        .replace("</ssv:Parameters>", f"</ssv:Parameters>{_UNITS.replace('ssd:', 'ssv:')}")
    )
    external = (
        '<ssd:ParameterBindings><ssd:ParameterBinding source="resources/values.ssv">{}'
        "</ssd:ParameterBinding></ssd:ParameterBindings>"
    )
    mapping = external.format('<ssd:ParameterMapping source="resources/names.ssm"/>')
    untyped = _component("source", "value", typed=False) + _component("sink", "u", "y", typed=False)
    nested = (
        f'<ssd:System name="inside">{_connectors("u")}<ssd:Elements>{_component("sink", "u", "y")}</ssd:Elements>'
        f"<ssd:Connections>{_wire('u', 'sink.u')}</ssd:Connections></ssd:System>"
    )
    level = _bound({"level": "high"})
    file = (
        '<ssd:Component name="source" type="text/csv" source="resources/values.csv">'
        f"{_connectors('value')}</ssd:Component>"
    )
    drive = _system(
        _component("source", "value") + _component("sink", "u", "y").replace("Switchboard", "Drive"),
        _wire("source.value", "sink.u"),
    )
    return [
        Case("a connection", "5.3.2", 6.0, _pair("value", "u")),
        Case("a connection written from its end to its start", "5.3.2.1", 6.0, _system(
            _component("source", "value") + _component("sink", "u", "y"), _wire("sink.u", "source.value"))),
        Case("connectors without a type", "5.2.1", 6.0, _system(untyped, _wire("source.value", "sink.u"))),
        Case("an Integer connected to a Real", "5.3.2", 6.0, _pair("count", "u")),
        Case("a Boolean connected to a Real", "5.3.2.1", 2.0, _pair("on", "u")),
        Case("a Boolean connected to an Integer", "5.3.2.1", 1.0, _pair("on", "n")),
        Case("a component of a nested system", "5.3", 6.0, _system(
            _component("source", "value") + nested, _wire("source.value", "inside.u"))),
        Case("linear transformation, factor and offset", "5.3.2.2", 14.0,
             _pair("value", "u", '<ssc:LinearTransformation factor="2" offset="1"/>')),
        Case("linear transformation, the factor's default", "5.3.2.2", 206.0,
             _pair("value", "u", '<ssc:LinearTransformation offset="100"/>')),
        Case("boolean mapping", "5.3.2.2", 1.0, _pair("off", "flag",
             '<ssc:BooleanMappingTransformation><ssc:MapEntry source="false" target="true"/>'
             "</ssc:BooleanMappingTransformation>")),
        Case("integer mapping", "5.3.2.2", 30.0, _pair("count", "n",
             '<ssc:IntegerMappingTransformation><ssc:MapEntry source="3" target="30"/>'
             "</ssc:IntegerMappingTransformation>")),
        Case("units that differ by a factor", "5.3.2", 3000.0, _pair("far", "length")),
        Case("units that differ by an offset", "5.3.2", 276.15, _pair("warm", "temperature")),
        Case("inline parameter values", "5.2.3", 10.0, _pair("value", "u", of_source=_bound({"k": "5"}))),
        Case("a value in another unit than the connector", "6", 3006.0, _system(
            _component("source", "value") + _component("sink", "u", "length", "y", bindings=distance),
            _wire("source.value", "sink.u"))),
        Case("of two bindings the later one", "5.2.3", 14.0, _pair(
            "value", "u", of_source=_bound({"k": "5"}, {"k": "7"}))),
        Case("the outer of two bindings", "5.2.3", 14.0, _pair(
            "value", "u", of_source=_bound({"k": "5"}), outer=_bound({"source.k": "7"}))),
        Case("an enumeration set by its item's name", "6", 406.0, _pair("value", "u", of_sink=level)),
        Case("an external .ssv", "5.2.3", 10.0, _pair("value", "u", of_source=external.format("")),
             {"resources/values.ssv": ssv}),
        Case("a parameter mapping (.ssm)", "7", 8.0, _pair("value", "u", of_source=mapping),
             {"resources/values.ssv": other, "resources/names.ssm": ssm}),
        Case("an entry of a mapping with an empty source", "7", 8.0, _pair("value", "u", of_source=mapping),
             {"resources/values.ssv": other, "resources/names.ssm": gap}),
        Case("a CSV file as a component (text/csv)", "5.4", 6.0, _system(
            file + _component("sink", "u", "y"), _wire("source.value", "sink.u")),
            {"resources/values.csv": "time,value\n0,3\n2,3\n"}),
        Case("an FMU of FMI 3.0 for co-simulation", "5.4", 6.0, drive, sink=(3, "CS", False)),
        Case("an FMU of FMI 1.0 for co-simulation", "5.4", 6.0, drive, sink=(1, "CS", False)),
        Case("an FMU of FMI 2.0 for Model Exchange", "5.4", 6.0, drive, sink=(2, "ME", False), tolerance=1e-5),
        Case("an FMU of FMI 3.0 for Model Exchange", "5.4", 6.0, drive, sink=(3, "ME", False), tolerance=1e-5),
        Case("an FMU with sources and no binary", "5.4", 6.0, drive, sink=(2, "CS", True)),
    ]  # fmt: skip


def write(case: Case, fmu: Path, path: Path) -> None:
    document = (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<ssd:SystemStructureDescription {_HEAD} version="1.0" name="engines">{case.body}{_ENUMERATIONS}{_UNITS}'
        f'<ssd:DefaultExperiment startTime="0" stopTime="{STOP}"/></ssd:SystemStructureDescription>'
    )
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("SystemStructure.ssd", document)
        archive.write(fmu, "resources/Switchboard.fmu")
        for name, text in case.files.items():
            archive.writestr(name, text)
        if case.sink is not None:
            archive.write(drive_fmu(*case.sink, path.parent), "resources/Drive.fmu")


# ---- engines: sink.y at the end ---------------------------------------------------------------


def ours(path: str) -> float:
    import pyarrow.parquet as pq

    from cosim_master.execution.options import RunOptions
    from cosim_master.execution.simulate import simulate

    with tempfile.TemporaryDirectory() as out:
        result = simulate(path, RunOptions(out=Path(out), step=STEP))
        if result.outcome != "done":
            raise RuntimeError(str(result.error))
        table = pq.read_table(Path(out) / "signals.parquet")
        (name,) = [n for n in table.column_names if n.endswith("sink.y")]
        return float(table[name].to_pylist()[-1])


def fmpy(path: str) -> float:
    from fmpy.ssp.simulation import simulate_ssp

    result = simulate_ssp(path, stop_time=STOP, step_size=STEP)
    (name,) = [n for n in result.dtype.names if n.endswith("sink.y")]
    return float(result[name][-1])


def libcosim(path: str) -> float:
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimObserver import CosimObserver

    execution = CosimExecution.from_ssp_file(path, round(STEP * 1e9))
    observer = CosimObserver.create_last_value()
    if not execution.add_observer(observer):
        raise RuntimeError("no observer")
    for _ in range(round(STOP / STEP)):
        if not execution.step():
            raise RuntimeError("a step failed")
    slave = execution.slave_index_from_instance_name("sink")
    (reference,) = [v.reference for v in execution.slave_variables(slave) if v.name == b"y"]
    return float(observer.last_real_values(slave, [reference])[0])


def ecos(path: str) -> float:
    # The tbb wheel puts the library that ecospy needs where the loader does not look.
    ctypes.CDLL(str(Path(sys.prefix) / "lib" / "libtbb.so.12"), mode=ctypes.RTLD_GLOBAL)
    from ecospy import EcosSimulation

    with EcosSimulation(ssp_path=path, step_size=STEP) as simulation:
        simulation.init(parameter_set="set")
        for _ in range(round(STOP / STEP)):
            simulation.step(1)
        return float(simulation.get_real("sink::y"))


_MASTER = (
    '<ssd:Annotations><ssc:Annotation type="org.openmodelica"><oms:Annotations '
    'xmlns:oms="https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd">'
    f'<oms:SimulationInformation><oms:FixedStepMaster description="oms-ma" stepSize="{STEP}"/>'
    "</oms:SimulationInformation></oms:Annotations></ssc:Annotation></ssd:Annotations>"
)
"""Without it OMSimulator does not know what kind of system it has, and runs none."""


def _with_master(path: str, to: Path) -> None:
    with zipfile.ZipFile(path) as given, zipfile.ZipFile(to, "w", zipfile.ZIP_DEFLATED) as made:
        for name in given.namelist():
            data = given.read(name)
            if name == "SystemStructure.ssd":
                head, end, tail = data.decode().rpartition("</ssd:System>")
                data = (head + _MASTER + end + tail).encode()
            made.writestr(name, data)


def omsimulator(path: str) -> float:
    with tempfile.TemporaryDirectory() as folder:
        file, annotated = Path(folder) / "result.csv", Path(folder) / "system.ssp"
        _with_master(path, annotated)
        options = [f"--resultFile={file}", f"--stopTime={STOP}", f"--stepSize={STEP}", f"--tempDir={folder}"]
        command = [os.environ["OMSIMULATOR"], *options, str(annotated)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if not file.exists():
            raise RuntimeError((done.stdout + done.stderr).strip().splitlines()[-1:] or "no result")
        rows = list(csv.reader(file.open()))
        (column,) = [i for i, name in enumerate(rows[0]) if name.endswith("sink.y")]
        return float(rows[-1][column])


ENGINES = {"uav-cosim": ours, "FMPy": fmpy, "libcosim": libcosim, "Ecos": ecos, "OMSimulator": omsimulator}
_PACKAGES = {"uav-cosim": "uav-cosim", "FMPy": "fmpy", "libcosim": "libcosimpy", "Ecos": "ecospy"}


def available(names: list[str]) -> dict[str, str]:
    """Engines that are here, with their versions."""
    found = {}
    for name in names:
        if name == "OMSimulator":
            if program := os.environ.get("OMSIMULATOR"):
                told = subprocess.run([program, "--version"], capture_output=True, text=True, check=True).stdout
                release, *rest = told.split()[1].removeprefix("v").split("-")
                commits = [part.removeprefix("g") for part in rest if re.fullmatch("g?[0-9a-f]{7,}", part)]
                found[name] = f"{release} ({commits[0]})" if commits else release
            continue
        try:
            found[name] = version(_PACKAGES[name])
        except PackageNotFoundError:
            print(f"{name} is not installed: left out", file=sys.stderr)
    return found


def given(engine: str, path: Path) -> float | str:
    """What an engine makes of a system: its number, or why there is none."""
    command = [sys.executable, __file__, "--one", engine, str(path)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    except subprocess.TimeoutExpired:
        return "hangs"
    for line in done.stdout.splitlines():
        if line.startswith("VALUE "):
            return float(line.split()[1])
    if done.returncode < 0:
        return f"crash (signal {-done.returncode})"
    return "error"


def build_fmu(folder: Path) -> Path:
    from cosim.build import build, load_models

    (model,) = load_models(str(Path(__file__).parent / "models" / "switchboard.py"))
    return build(model, folder).file


def drive_fmu(fmi: int, kinds: str, sources: bool, folder: Path) -> Path:
    """An FMU of the tests' hybrid models: x' = u, y = x + u."""
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from tests.master.fmus.dynamics import SOURCE, Dynamics

    text = f"#define MODEL 5\n#define FMI {fmi}\n{SOURCE.read_text()}"
    extra = {"sources/dynamic.c": text} if sources else {}
    dynamics = Dynamics(folder, folder)
    return dynamics.fmu("DRIVE", fmi, kinds, stop=STOP, step=STEP, sources=sources, binary=not sources, extra=extra)


def table(names: dict[str, str], results: dict[str, dict[str, float | str]]) -> str:
    lines = [
        "# Results of several engines for the same systems",
        "",
        "Each row is a small SSP that tests one rule of the standard (SSP 2.0, section). The number is the output",
        "of a component after one second of simulated time, computed by hand; **bold** is correct. All engines get",
        "the same archive and no further input, with two exceptions: Ecos applies parameter sets only by name and",
        "is given the name; OMSimulator requires its own annotation that names a master and is given one. The table",
        "is written by `python benchmarks/engines.py --write docs/engines.md`, with `OMSIMULATOR` set to a build of",
        f'OMSimulator. An engine that was not given a system is marked "{NOT_RUN}". The FMUs of the last rows are',
        "parts of a system; alone, FMPy runs FMUs for Model Exchange and of FMI 3.0 as well. Connections of different",
        "types may be refused (5.3.2.1); if they are accepted, true is 1. Results of systems that are part of those",
        "engines are in [other-engines-files.md](other-engines-files.md#what-was-measured), times in",
        "[benchmarks](../benchmarks/README.md#masters-compared).",
        "",
        "| rule | section | by the standard | " + " | ".join(f"{n} {v}" for n, v in names.items()) + " |",
        "|---|---|---|" + "---|" * len(names),
    ]
    for case in cases():
        cells = []
        for engine in names:
            got = results[case.name][engine]
            right = case.is_right(got)
            text = f"{got:g}" if isinstance(got, float) else got
            cells.append(f"**{text}**" if right else text)
        lines.append(f"| {case.name} | {case.section} | {case.expected:g} | " + " | ".join(cells) + " |")
    counts = []
    for engine in names:
        run = [case for case in cases() if results[case.name][engine] != NOT_RUN]
        right = [case.is_right(results[case.name][engine]) for case in run]
        counts.append(f"{sum(right)} of {len(right)}")
    lines.append("| right | | | " + " | ".join(counts) + " |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--engines", nargs="+", default=list(ENGINES), choices=list(ENGINES))
    parser.add_argument("--write", type=Path, help="Markdown file for the table")
    parser.add_argument("--one", nargs=2, metavar=("ENGINE", "SSP"), help="run one system and print its number")
    parser.add_argument("--rules", default="", help="only rules that have this in their name")
    options = parser.parse_args()
    if options.one:
        print("VALUE", repr(ENGINES[options.one[0]](options.one[1])), flush=True)
        os._exit(0)  # how these tools shut down is not our subject
    names = available(options.engines)
    results: dict[str, dict[str, float | str]] = {}
    with tempfile.TemporaryDirectory() as folder:
        fmu = build_fmu(Path(folder))
        for i, case in enumerate(cases()):
            if options.rules not in case.name:
                results[case.name] = dict.fromkeys(names, NOT_RUN)
                continue
            path = Path(folder) / f"case{i}.ssp"
            write(case, fmu, path)
            results[case.name] = {engine: given(engine, path) for engine in names}
    text = table(names, results)
    print(text)
    if options.write:
        options.write.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
