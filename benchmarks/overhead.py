"""What a master costs: time per FMU step of ours, of a C program, of FMPy's calls, of libcosim and of Ecos.

A ring of N instances of one compiled FMU: inputs of each come from the outputs of the one before. `floor.c` makes the
same FMI calls with the same exchange of values, laid out as our plan lays them out; what a master takes beyond it is
its overhead. All take turns in one run, so that what else the machine does strikes all alike; figures are of the best
turn of each: a median punishes C, a process of its own that wakes up for each turn. Medians are in the JSON.

    python benchmarks/overhead.py [--instances 1 10 100 1000] [--fmus Relay Quadrotor] [--fmi 3] [--json FILE]

Ours, C and FMPy's calls make the same calls, and their outputs are compared bit by bit first. libcosim and Ecos
move connected values only and do it their own way. libcosim steps with all cores, the others with one thread.
libcosimpy and ecospy take part where they are installed. With FMUs of FMI 3.0 there are ours and C (`floor3.c`) only.
"""

from __future__ import annotations

import argparse
import ctypes
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from importlib import import_module
from os.path import relpath
from pathlib import Path
from typing import Any, Protocol

from floor3 import calls_of
from report import machine, show, write

from cosim.build import build, load_models
from cosim_master.execution.execution import Execution
from cosim_master.execution.run.opening import Setup
from cosim_master.fmi.calls import KINDS
from cosim_master.fmi.slaves.isolated import Isolation
from cosim_master.stepping.layout import Layout, make_layout
from cosim_master.system.flatten.check import check
from cosim_master.system.reading.read import read_system
from cosim_master.system.settings.network import network_of
from cosim_master.system.settings.time_grid import time_grid

HERE = Path(__file__).parent
STEP = 0.0025
COMPARED = 20
"""Steps after which outputs are compared, and caches are warm."""
RINGS = {
    "Relay": (str(HERE / "models" / "relay.py"), [(f"y[{i}]", f"u[{i}]") for i in range(1, 5)]),
    # All motors follow the real part of the attitude, which is 1 as long as it climbs upright. It always does.
    "Quadrotor": ("cosim_models.vehicles.quadrotor", [("attitude[1]", f"motor[{i}]") for i in range(1, 9)]),
}
"""Per FMU: where its model is, and what goes from each instance to the next."""


class Master(Protocol):
    """Something that steps the ring."""

    name: str

    def run(self, steps: int) -> float:
        """Step every instance `steps` times; returns the seconds that took."""


class Ours:
    """The plan and its loop, driven through `Execution`, without recording."""

    name = "uav-cosim"

    def __init__(self, folder: Path, until: float, stack: ExitStack, isolation: Isolation | None = None) -> None:
        checked = check(stack.enter_context(read_system(folder)))
        network = network_of(checked)
        self.clock = time_grid(checked, until)
        self.layout = make_layout(checked, network)
        self.execution = stack.enter_context(
            Execution(
                checked, self.clock, self.layout, network, Setup(every=self.clock.steps, threads=1, isolation=isolation)
            )
        )

    def run(self, steps: int) -> float:
        stop = self.execution.k + steps
        began = time.perf_counter()
        self.execution.advance(stop)
        return time.perf_counter() - began

    def values(self) -> list[float]:
        return [*self.execution.plan.real_out.tolist(), *self.execution.plan.int_out.tolist()]

    def description(self, library: Path) -> str:
        """The plan in the format that floor.c reads."""
        plan, clock = self.execution.plan, self.clock
        fmu = self.execution.slaves[0].library.fmu
        stop = clock.start + clock.steps * clock.base
        lines = [f"{library} {fmu.guid} {(library.parents[2] / 'resources').as_uri()}"]
        three = fmu.fmi_version.startswith("3.")
        if three:
            lines = [f"{library} {fmu.guid} {library.parents[2] / 'resources'}/"]
        lines.append(f"{clock.start} {clock.base} {stop}")
        inputs, outputs = _references(self.layout)
        n_in, n_out = len(inputs), len(outputs)
        lines.append(f"{plan.instances.size} {n_in} {n_out} {plan.real_in.size} {plan.real_out.size}")
        if three:
            lines += calls_of(self.execution)
        for row in () if three else plan.feeds:
            lines.append(
                " ".join(
                    str(row[name][kind])
                    for kind in range(3)
                    for name in ("first_in", "last_in", "first_out", "last_out")
                )
            )
        wires = [*plan.wires.tolist(), *[(1.0, 0.0)] * plan.int_in.size]
        for reference, source, (factor, offset) in zip(inputs, plan.sources, wires, strict=True):
            lines.append(f"{'' if three else reference} {source} {factor!s} {offset!s}")
        lines.append("" if three else " ".join(map(str, outputs)))
        return "\n".join(lines) + "\n"


def _references(layout: Layout) -> tuple[list[int], list[int]]:
    """The value references of all inputs and of all outputs, in the order of the plan."""
    ports = [layout.ports[kind] for kind in KINDS]
    inputs = [v.value_reference for p in ports for v in p.inputs]
    return inputs, [v.value_reference for p in ports for _, v in p.outputs]


class Floor:
    """floor.c, as a process of its own."""

    name = "C"

    def __init__(self, program: Path, description: Path, stack: ExitStack) -> None:
        pipe = subprocess.PIPE
        self._process = stack.enter_context(
            subprocess.Popen([str(program), str(description)], stdin=pipe, stdout=pipe, text=True)
        )

    def _ask(self, request: str) -> str:
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(request + "\n")
        self._process.stdin.flush()
        answer = self._process.stdout.readline()
        if not answer:
            raise RuntimeError(f"floor.c ended with exit code {self._process.wait()}; its message is above")
        return answer

    def run(self, steps: int) -> float:
        return float(self._ask(f"run {steps}"))

    def values(self) -> list[float]:
        return [float(word) for word in self._ask("values").split()]


class FmpyCalls:
    """The calls one writes with FMPy: setReal, doStep, getReal of one FMU2Slave per instance."""

    name = "FMPy"

    def __init__(self, ours: Ours, unpacked: Path, until: float, stack: ExitStack) -> None:
        from fmpy.fmi2 import FMU2Slave

        plan, fmu = ours.execution.plan, ours.execution.slaves[0].library.fmu
        in_references, out_references = _references(ours.layout)
        self._outputs: list[Any] = [0.0] * len(out_references)
        self._k = 0
        self._rows: list[tuple[Any, list[int], list[tuple[int, float, float]], list[tuple[Any, list[int], slice]]]] = []
        for i, row in enumerate(plan.feeds):
            slave = FMU2Slave(
                guid=fmu.guid, unzipDirectory=str(unpacked), modelIdentifier=fmu.model_identifier, instanceName=f"n{i}"
            )
            slave.instantiate()
            stack.callback(slave.freeInstance)
            slave.setupExperiment(startTime=0.0, stopTime=until)
            slave.enterInitializationMode()
            slave.exitInitializationMode()
            inputs = slice(int(row["first_in"][0]), int(row["last_in"][0]))
            wires = [(int(j), *wire.item()) for j, wire in zip(plan.sources[inputs], plan.wires[inputs], strict=True)]
            gets: list[tuple[Any, list[int], slice]] = []
            for kind, getter in enumerate((slave.getReal, slave.getInteger, slave.getBoolean)):
                place = slice(int(row["first_out"][kind]), int(row["last_out"][kind]))
                if place.stop > place.start:
                    gets.append((getter, out_references[place], place))
            self._rows.append((slave, in_references[inputs], wires, gets))
        for _, _, _, gets in self._rows:
            for getter, references, place in gets:
                self._outputs[place] = getter(references)

    def run(self, steps: int) -> float:
        outputs = self._outputs
        began = time.perf_counter()
        for _ in range(steps):
            t = self._k * round(STEP * 1e9) / 1e9
            inputs = [[factor * outputs[j] + offset for j, factor, offset in wires] for _, _, wires, _ in self._rows]
            for values, (slave, own, _, gets) in zip(inputs, self._rows, strict=True):
                slave.setReal(own, values)
                slave.doStep(t, STEP)
                for getter, references, place in gets:
                    outputs[place] = getter(references)
            self._k += 1
        return time.perf_counter() - began

    def values(self) -> list[float]:
        return self._outputs


class Libcosim:
    """libcosim's fixed-step algorithm, through libcosimpy."""

    name = "libcosim"

    def __init__(self, ours: Ours) -> None:
        CosimExecution = import_module("libcosimpy.CosimExecution").CosimExecution
        CosimLocalSlave = import_module("libcosimpy.CosimSlave").CosimLocalSlave
        import_module("libcosimpy.CosimLogging").log_output_level(
            import_module("libcosimpy.CosimLogging").CosimLogLevel.ERROR
        )
        fmu = ours.execution.slaves[0].library.fmu
        n = len(ours.execution.slaves)
        self._execution = CosimExecution.from_step_size(round(STEP * 1e9))
        self._slaves = [CosimLocalSlave(str(fmu.path), f"n{i}") for i in range(n)]
        for slave in self._slaves:
            self._execution.add_local_slave(slave)
        for i in range(n):
            for source, target in RINGS[fmu.model_name][1]:
                a, b = fmu.variables[source].value_reference, fmu.variables[target].value_reference
                self._execution.connect_real_variables(i, a, (i + 1) % n, b)

    def run(self, steps: int) -> float:
        began = time.perf_counter()
        if not self._execution.step(steps):
            raise RuntimeError("libcosim failed")
        return time.perf_counter() - began


def load_tbb() -> None:
    """Loads the library that ecospy needs: the tbb wheel puts it where the loader does not look."""
    ctypes.CDLL(str(Path(sys.prefix) / "lib" / "libtbb.so.12"), mode=ctypes.RTLD_GLOBAL)


class Ecos:
    """Ecos' fixed-step algorithm, through ecospy; each FMU in a process of its own if `proxy`, which PATH must have."""

    name = "Ecos"

    def __init__(self, ours: Ours, stack: ExitStack, *, proxy: bool = False) -> None:
        load_tbb()
        ecospy = import_module("ecospy")
        fmu = ours.execution.slaves[0].library.fmu
        n = len(ours.execution.slaves)
        structure = stack.enter_context(ecospy.EcosSimulationStructure())
        for i in range(n):
            structure.add_model(f"n{i}", f"proxyfmu://localhost?file={fmu.path}" if proxy else str(fmu.path))
        for i in range(n):
            for source, target in RINGS[fmu.model_name][1]:
                structure.make_real_connection(f"n{i}::{source}", f"n{(i + 1) % n}::{target}")
        self._simulation = stack.enter_context(ecospy.EcosSimulation(step_size=STEP, structure=structure))
        self._simulation.init()

    def run(self, steps: int) -> float:
        began = time.perf_counter()
        self._simulation.step(steps)
        return time.perf_counter() - began


def write_ring(folder: Path, fmu: Path, n: int) -> None:
    """The system: N components, each connected to the next."""
    connections = RINGS[fmu.name.partition(".")[0]][1]
    connectors = "".join(
        f'<ssd:Connector name="{name}" kind="{kind}"/>'
        for side, kind in ((0, "output"), (1, "input"))
        for name in dict.fromkeys(pair[side] for pair in connections)
    )
    parts = [
        f'<ssd:Component name="n{i}" type="application/x-fmu-sharedlibrary" source="{relpath(fmu, folder)}">'
        f"<ssd:Connectors>{connectors}</ssd:Connectors></ssd:Component>"
        for i in range(n)
    ]
    wires = [
        f'<ssd:Connection startElement="n{i}" startConnector="{source}" '
        f'endElement="n{(i + 1) % n}" endConnector="{target}"/>'
        for i in range(n)
        for source, target in connections
    ]
    (folder / "SystemStructure.ssd").write_text(
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        '<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription" '
        f'name="ring" version="1.0"><ssd:System name="ring"><ssd:Elements>{"".join(parts)}</ssd:Elements>'
        f"<ssd:Connections>{''.join(wires)}</ssd:Connections></ssd:System></ssd:SystemStructureDescription>\n",
        encoding="utf-8",
    )


def compile_floor(folder: Path, fmi: int = 2) -> Path:
    """floor.c or floor3.c as a program, by the compiler that also builds our FMUs."""
    program = folder / "floor"
    source = HERE / ("floor3.c" if fmi == 3 else "floor.c")
    command = [sys.executable, "-m", "ziglang", "cc", "-O2", "-Wall", "-Wextra", str(source), "-ldl"]
    subprocess.run([*command, "-o", str(program)], check=True)
    return program


def masters_of(
    fmu: Path, n: int, until: float, program: Path, wanted: Sequence[str], stack: ExitStack
) -> tuple[list[Master], dict[str, str]]:
    """All that take part in the order of their turns, and why others do not."""
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="uav-cosim-overhead-")))
    write_ring(folder, fmu, n)
    ours = Ours(folder, until, stack)
    library = ours.execution.slaves[0].library
    unpacked = library.resources.parent
    text = ours.description(unpacked.joinpath(*library.fmu.library.split("/")))
    (folder / "ring.txt").write_text(text, encoding="utf-8")
    makers: dict[str, Callable[[], Master]] = {
        "C": lambda: Floor(program, folder / "ring.txt", stack),
        "uav-cosim": lambda: ours,
        "FMPy": lambda: FmpyCalls(ours, unpacked, until, stack),
        "libcosim": lambda: Libcosim(ours),
        "Ecos": lambda: Ecos(ours, stack),
    }
    masters, absent = [], {}
    for name, make in makers.items():
        if name not in wanted:
            continue
        try:
            masters.append(make())
        except (ImportError, OSError) as error:
            absent[name] = str(error)
    return masters, absent


PER_ROUND = {"C": 100_000, "uav-cosim": 100_000, "FMPy": 2000, "libcosim": 2000, "Ecos": 20_000}
"""FMU steps in one turn: some ten milliseconds."""


def measure(fmu: Path, n: int, rounds: int, scale: float, program: Path, wanted: Sequence[str]) -> dict[str, Any]:
    """The best and the median over `rounds` turns of the time per FMU step in us, for a ring of `n` instances."""
    steps = {name: max(1, round(count * scale / n)) for name, count in PER_ROUND.items()}
    until = (rounds * max(steps.values()) + COMPARED) * STEP
    with ExitStack() as stack:
        masters, absent = masters_of(fmu, n, until, program, wanted, stack)
        times: dict[str, list[float]] = {master.name: [] for master in masters}
        compare(masters, COMPARED)
        for _ in range(rounds):
            for master in masters:
                seconds = master.run(steps[master.name])
                times[master.name].append(1e6 * seconds / (n * steps[master.name]))
    row: dict[str, Any] = {"fmu": fmu.stem, "instances": n, "absent": absent, "us_per_fmu_step": {}, "median_us": {}}
    for name, measured in times.items():
        row["us_per_fmu_step"][name] = min(measured)
        row["median_us"][name] = statistics.median(measured)
    row["ratio_to_C"] = row["us_per_fmu_step"]["uav-cosim"] / row["us_per_fmu_step"]["C"]
    return row


def compare(masters: Sequence[Master], steps: int) -> None:
    """Step all; whoever makes the same calls must then have the same numbers, bit by bit."""
    values = {}
    for master in masters:
        master.run(steps)
        if isinstance(master, (Floor, Ours, FmpyCalls)):
            values[master.name] = master.values()
    for name, numbers in values.items():
        if numbers != values["C"]:
            raise RuntimeError(f"after {steps} steps the outputs of {name} are not those of C")


def _cells(row: dict[str, Any]) -> list[str]:
    times = row["us_per_fmu_step"]
    mine = times["uav-cosim"] - times["C"]
    cells = [f"{row['fmu']} x {row['instances']}", f"{times['C']:.3f}", f"{times['uav-cosim']:.3f}"]
    cells.append(f"{row['ratio_to_C']:.2f}")
    for name in ("FMPy", "libcosim", "Ecos"):
        if name not in times:
            cells += ["-", "-"]
            continue
        ratio = (times[name] - times["C"]) / mine if mine > 0 else float("inf")
        cells += [f"{times[name]:.2f}", f"{ratio:.0f} x" if mine > 0 else "all of it"]
    return cells


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--instances", type=int, nargs="+", default=[1, 10, 100, 1000], metavar="N")
    parser.add_argument("--fmus", nargs="+", choices=list(RINGS), default=list(RINGS))
    parser.add_argument("--fmi", type=int, choices=(2, 3), default=2, help="version of the FMUs")
    parser.add_argument("--masters", nargs="+", choices=list(PER_ROUND)[2:], default=list(PER_ROUND)[2:])
    parser.add_argument("--rounds", type=int, default=15, help="turns of each")
    parser.add_argument("--scale", type=float, default=1.0, help="times the steps of a turn")
    parser.add_argument("--json", type=Path, metavar="FILE")
    options = parser.parse_args(arguments)
    host = machine("fmpy", "libcosimpy", "ecospy", "ziglang")
    rows = []
    with tempfile.TemporaryDirectory(prefix="uav-cosim-overhead-") as temporary:
        folder = Path(temporary).resolve()
        program = compile_floor(folder, options.fmi)
        for name in options.fmus:
            (model,) = load_models(RINGS[name][0])
            fmu = build(model, folder, fmi=options.fmi).file
            for n in options.instances:
                wanted = ("C", "uav-cosim", *(options.masters if options.fmi == 2 else ()))
                rows.append(measure(fmu, n, options.rounds, options.scale, program, wanted))
    columns = ["us per FMU step", "C", "uav-cosim", "/ C"]
    for name in ("FMPy", "libcosim", "Ecos"):
        columns += [name, "overhead"]
    absent = {name: why for row in rows for name, why in row["absent"].items()}
    note = "overhead: how many times what uav-cosim takes beyond C. "
    note += "".join(f"{name} did not take part: {why}. " for name, why in absent.items())
    show(
        "Cost of a master: rings of compiled FMUs, one thread, no recording",
        host,
        columns,
        list(map(_cells, rows)),
        note,
    )
    write(options.json, host, {"benchmark": "overhead", "fmi": options.fmi, "rows": rows})


if __name__ == "__main__":
    main()
