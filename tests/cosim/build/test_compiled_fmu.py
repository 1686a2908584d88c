"""Compiled FMUs: their symbols, their numbers, many instances and threads, saved states, other platforms and tools."""

from __future__ import annotations

import base64
import binascii
import ctypes
import importlib
import importlib.util
import os
import pkgutil
import re
import struct
import subprocess
import sys
import threading
import zipfile
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

from cosim import Model
from cosim.build import build, models_of_package
from cosim.model import record_layout
from tests.cosim.shipped import models_with_kernels
from tests.models.shipped_kernels import kernels

MODELS = models_with_kernels()
every_model = pytest.mark.parametrize("name", sorted(MODELS))
STEPS = 120
FUNCTIONS = """CancelStep DeSerializeFMUstate DoStep EnterInitializationMode ExitInitializationMode FreeFMUstate
FreeInstance GetBoolean GetBooleanStatus GetDirectionalDerivative GetFMUstate GetInteger GetIntegerStatus GetReal
GetRealOutputDerivatives GetRealStatus GetStatus GetString GetStringStatus GetTypesPlatform GetVersion Instantiate
Reset SerializeFMUstate SerializedFMUstateSize SetBoolean SetDebugLogging SetFMUstate SetInteger SetReal
SetRealInputDerivatives SetString SetupExperiment Terminate"""
OWN = ("uav_cosim_expect", "uav_cosim_make_step", "uav_cosim_note_step")
EXPORTED = {*OWN, *(f"fmi2{name}" for name in FUNCTIONS.split())}


def _load(file: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(file, (Path(__file__).parents[1] / f"{file}.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


driving = _load("driving")
driving.inputs = cache(driving.inputs)  # which are asked for in each step


class Factory:
    """Instances of one FMU, all from one extraction, as FMPy makes them."""

    def __init__(self, file: Path, folder: Path) -> None:
        self.description = fmpy.read_model_description(str(file))
        self.folder = fmpy.extract(str(file), str(folder))
        self.log: list[str] = []
        self._callbacks = fmi2CallbackFunctions()
        self._callbacks.logger = fmi2CallbackLoggerTYPE(lambda *a: self.log.append(a[4].decode()))

    def __call__(self, name: str = "one", initialise: bool = True) -> FMU2Slave:
        identifier = self.description.coSimulation.modelIdentifier
        fmu = FMU2Slave(
            guid=self.description.guid, unzipDirectory=self.folder, modelIdentifier=identifier, instanceName=name
        )
        fmu.instantiate(callbacks=self._callbacks)
        if initialise:
            fmu.setupExperiment(startTime=0.0)
            fmu.enterInitializationMode()
            fmu.exitInitializationMode()
        return fmu


def advance(model: type[Model], fmu: FMU2Slave, first: int, last: int) -> None:
    for step in range(first, last):
        driving.set_inputs(model, fmu, step)
        fmu.doStep(step * model.step_size, model.step_size)


def serialized(fmu: FMU2Slave) -> bytes:
    state = fmu.getFMUState()
    data = bytes(fmu.serializeFMUstate(state))
    fmu.freeFMUState(state)
    return data


def library(file: Path, folder: Path, platform: str = "linux64") -> Path:
    with zipfile.ZipFile(file) as archive:
        (name,) = [n for n in archive.namelist() if n.startswith(f"binaries/{platform}/")]
        return Path(archive.extract(name, folder))


# -- the binary -----------------------------------------------------------------------------------------------------


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads ELF")
@every_model
def test_symbols(name: str, fmus: Path, tmp_path: Path) -> None:
    defined, undefined = elf_symbols(library(fmus / f"{name}.fmu", tmp_path).read_bytes())
    assert defined == EXPORTED
    resolvable = ctypes.CDLL("libm.so.6"), ctypes.CDLL("libc.so.6")
    assert undefined
    for symbol in undefined:
        assert any(hasattr(one, symbol) for one in resolvable), symbol


def elf_symbols(data: bytes) -> tuple[set[str], set[str]]:
    """Defined and undefined dynamic symbols of a 64-bit little-endian ELF file, weak references left out."""
    assert data[:6] == b"\x7fELF\x02\x01"
    (sections,) = struct.unpack_from("<Q", data, 40)
    size, count = struct.unpack_from("<HH", data, 58)
    table = [struct.unpack_from("<IIQQQQIIQQ", data, sections + i * size) for i in range(count)]
    (dynsym,) = [s for s in table if s[1] == 11]
    strings = table[dynsym[6]][4]
    defined, undefined = set(), set()
    for at in range(dynsym[4] + 24, dynsym[4] + dynsym[5], 24):
        name, info, _, section = struct.unpack_from("<IBBH", data, at)
        text = data[strings + name : data.index(0, strings + name)].decode()
        if section:
            defined.add(text)
        elif info >> 4 != 2:
            undefined.add(text)
    return defined, undefined


# -- the same numbers -----------------------------------------------------------------------------------------------


PLAIN_PYTHON = """
import importlib, runpy, sys
import numpy as np
drive = runpy.run_path(sys.argv[1])["drive_record"]
for line in sys.stdin:
    module, name, file = line.split("\\t")
    np.save(file.rstrip("\\n"), drive(getattr(importlib.import_module(module), name), 60))
    print(name, flush=True)
"""
"""Drives models, one a line, whose kernels are plain Python."""


@pytest.fixture(scope="module")
def interpreted(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], Any]]:
    """What plain Python makes of the models: all of them in one process, so that it is started and imports once."""
    folder = tmp_path_factory.mktemp("plain")
    script = [sys.executable, "-c", PLAIN_PYTHON, str(Path(__file__).parents[1] / "driving.py")]
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    with subprocess.Popen(script, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None and process.stdout is not None

        def rows_of(name: str) -> Any:
            file = folder / f"{name}.npy"
            print(MODELS[name].__module__, name, file, sep="\t", file=process.stdin, flush=True)
            assert process.stdout is not None and process.stdout.readline() == f"{name}\n"
            return np.load(file)

        yield rows_of
        process.stdin.close()
        assert process.wait() == 0


@every_model
def test_record_fmu_and_plain_python_agree(
    name: str, fmus: Path, tmp_path: Path, interpreted: Callable[[str], Any]
) -> None:
    """The kernels' object code, plain Python and the FMU: the same bits after every step."""
    model = MODELS[name]
    rows = driving.drive_record(model, STEPS, kernels(model))
    plain = interpreted(name)
    assert len(plain) == 61
    for step in range(len(plain)):
        assert same(model, rows[step], plain[step]), f"record after step {step}"
    fmu = Factory(fmus / f"{name}.fmu", tmp_path)()
    for step in range(STEPS + 1):
        assert driving.read(model, fmu) == driving.read_record(model, rows[step]), f"FMU after step {step}"
        advance(model, fmu, step, step + 1)
    fmu.freeInstance()
    assert (rows[0] != rows[-1]).any()


def same(model: type[Model], a: Any, b: Any) -> bool:
    """Equal fields; the padding between them does not count."""
    dtype, _ = record_layout(model.variables)
    x, y = (row.copy().view(dtype)[0] for row in (a, b))
    assert dtype.names is not None
    return all(np.array_equal(x[field], y[field], equal_nan=dtype[field].kind == "f") for field in dtype.names)


@every_model
def test_simulate_fmu_gives_the_same_for_both_builds(name: str, fmus: Path, tmp_path: Path) -> None:
    interpreted = build(MODELS[name], tmp_path, interpreted=True).file
    results = [fmpy.simulate_fmu(str(file), stop_time=0.5) for file in (fmus / f"{name}.fmu", interpreted)]
    assert len(results[0]) > 10
    for column in results[0].dtype.names:
        if results[0][column].dtype.kind == "f":
            np.testing.assert_allclose(results[0][column], results[1][column], rtol=1e-12, atol=0, err_msg=column)
        else:
            assert list(results[0][column]) == list(results[1][column]), column


def test_every_kernel_is_compiled(fmus: Path) -> None:
    """By an FMU, which is compiled as a whole, or, of what no model calls, by the tests of its own module."""
    package = importlib.import_module("cosim_models")
    names = [module.name for module in pkgutil.walk_packages(package.__path__, "cosim_models.")]
    modules = [importlib.import_module(name) for name in ("cosim.packets", "cosim.messages", "cosim.frames", *names)]
    kernels = {v for m in modules for v in vars(m).values() if hasattr(v, "py_func")}
    assert len(kernels) > 100
    for kernel in kernels:
        assert kernel.targetoptions["nopython"], kernel
        assert kernel.targetoptions["error_model"] == "numpy", kernel
    reached: set[Any] = set()
    for model in MODELS.values():
        assert build(model, fmus).compiled, model
    for shipped in models_of_package("cosim_models"):  # `make fmus` compiles them all
        reached |= callees(shipped.kernels or ())
    left = {kernel.py_func.__module__ for kernel in kernels - reached}
    tests = "".join(file.read_text() for file in Path(__file__).parents[2].rglob("*.py"))
    assert [module for module in sorted(left) if not re.search(rf"\b{module.rpartition('.')[2]}\b", tests)] == []


def callees(kernels: Iterable[Any]) -> set[Any]:
    """`kernels` and every kernel that they call, by the global names in their code and what they were made with."""
    found: set[Any] = set()
    waiting = list(kernels)
    while waiting:
        kernel = waiting.pop()
        if kernel not in found:
            found.add(kernel)
            function = kernel.py_func
            named = [function.__globals__.get(name) for name in function.__code__.co_names]
            made_with = [cell.cell_contents for cell in function.__closure__ or ()]
            waiting += [one for one in named + made_with if hasattr(one, "py_func")]
    return found


# -- values ---------------------------------------------------------------------------------------------------------


def _some_values(chosen: np.random.Generator) -> tuple[list[int], list[float]]:
    """Returns value references of a PointMass's Reals, in runs as masters set them, each with a value."""
    runs = [(first, min(first + chosen.integers(1, 24), 37)) for first in chosen.integers(37, size=chosen.integers(4))]
    references = [reference for run in runs for reference in range(*run)]
    values = chosen.uniform(0.01, 2.0, len(references))
    odd = chosen.random(len(references)) < chosen.choice([0.0, 0.02, 0.5])
    values[odd] = chosen.choice([np.nan, np.inf, -np.inf, -0.0, 1e-3, 9e-4], np.count_nonzero(odd))
    return references, values.tolist()


def test_values_that_are_set_together_are_set_as_one_by_one(fmus: Path, tmp_path: Path) -> None:
    make = Factory(fmus / "PointMass.fmu", tmp_path)
    together, single, flying = make(initialise=False), make(initialise=False), make()
    advance(MODELS["PointMass"], flying, 0, 9)
    size = record_layout(MODELS["PointMass"].variables)[0].itemsize
    failures: list[str] = []

    def record(fmu: FMU2Slave) -> bytes:
        return serialized(fmu)[-size - 8 : -8]  # a checksum follows

    def failure_of(fmu: FMU2Slave, calls: Iterable[tuple[list[int], list[float]]]) -> str | None:
        """Makes the calls; returns the text of the first one that fails."""
        make.log.clear()
        try:
            for references, values in calls:
                fmu.setReal(references, values)
        except FMICallException:
            return make.log[-1]
        return None

    chosen = np.random.default_rng(1)
    for _ in range(1000):
        references, values = _some_values(chosen)
        for fmu in (together, single):
            fmu.reset()
            fmu.setupExperiment(startTime=0.0)
            fmu.enterInitializationMode()
        before = record(together)
        failure = failure_of(together, [(references, values)])
        assert failure == failure_of(single, [([r], [v]) for r, v in zip(references, values, strict=True)])
        assert record(together) == (record(single) if failure is None else before)
        failures += [] if failure is None else [failure]
        found = flying.getReal(references), [flying.getReal([reference])[0] for reference in references]
        assert np.array(found[0]).tobytes() == np.array(found[1]).tobytes()
    assert 100 < len(failures) < 900
    assert {text.split(":")[1].split()[1] for text in failures} >= {"=", "is"}  # a value, and a role


# -- instances, threads, states -------------------------------------------------------------------------------------


@every_model
def test_instances_share_nothing(name: str, fmus: Path, tmp_path: Path) -> None:
    model, make = MODELS[name], Factory(fmus / f"{name}.fmu", tmp_path)
    alone = make("alone")
    advance(model, alone, 0, 40)
    expected = serialized(alone)
    first, second = make("first"), make("second")
    advance(model, first, 0, 15)
    advance(model, second, 0, 40)
    advance(model, first, 15, 40)
    assert serialized(first) == serialized(second) == expected
    first.freeInstance()
    assert serialized(second) == expected


@every_model
def test_threads_give_the_bits_of_one_thread(name: str, fmus: Path, tmp_path: Path) -> None:
    model, make = MODELS[name], Factory(fmus / f"{name}.fmu", tmp_path)
    lengths = [40, 41, 42, 43]
    expected = []
    for length in lengths:
        fmu = make()
        advance(model, fmu, 0, length)
        expected.append(serialized(fmu))
    parallel = [make(str(length)) for length in lengths]
    threads = [
        threading.Thread(target=advance, args=(model, fmu, 0, length))
        for fmu, length in zip(parallel, lengths, strict=True)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert [serialized(fmu) for fmu in parallel] == expected
    assert len(set(expected)) == 4


@every_model
def test_saved_states(name: str, fmus: Path, tmp_path: Path) -> None:
    model, make = MODELS[name], Factory(fmus / f"{name}.fmu", tmp_path)
    fmu = make()
    fresh = serialized(fmu)
    advance(model, fmu, 0, 25)
    state, stored = fmu.getFMUState(), serialized(fmu)
    advance(model, fmu, 25, 50)
    expected = serialized(fmu)
    assert expected != stored != fresh
    fmu.setFMUState(state)
    assert serialized(fmu) == stored
    advance(model, fmu, 25, 50)
    assert serialized(fmu) == expected
    fmu.freeFMUState(state)

    other = make("other")
    restored = other.deSerializeFMUstate(stored)
    other.setFMUState(restored)
    other.freeFMUState(restored)
    advance(model, other, 25, 50)
    assert serialized(other) == expected
    assert driving.read(model, other) == driving.read(model, fmu)

    fmu.reset()
    fmu.setupExperiment(startTime=0.0)
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    assert serialized(fmu) == fresh


def test_an_expected_instance_is_unchanged(fmus: Path, tmp_path: Path) -> None:
    model, make = MODELS["Quadrotor"], Factory(fmus / "Quadrotor.fmu", tmp_path)
    fmu, other = make(), make("other")
    expect = fmu.dll.uav_cosim_expect
    expect.argtypes, expect.restype = [ctypes.c_void_p], None
    for step in range(20):
        before = serialized(fmu)
        expect(fmu.component)
        assert serialized(fmu) == before
        advance(model, fmu, step, step + 1)
    advance(model, other, 0, 20)
    assert serialized(fmu) == serialized(other)


MEMORY = """
import ctypes, os, sys
import fmpy
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions

def resident():
    return int(open("/proc/self/statm").read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

description = fmpy.read_model_description(sys.argv[1])
identifier, folder = description.coSimulation.modelIdentifier, fmpy.extract(sys.argv[1], sys.argv[2])
fmu = FMU2Slave(guid=description.guid, unzipDirectory=folder, modelIdentifier=identifier, instanceName="one")
callbacks = fmi2CallbackFunctions()
assert ctypes.CDLL(None).mallopt(-3, 64 * 1024) == 1  # M_MMAP_THRESHOLD: larger blocks have pages of their own
for number in range(101):  # of one object of FMPy, which takes memory, too
    if number == 1:
        before = resident()
    fmu.instantiate(callbacks=callbacks)
    fmu.setupExperiment(startTime=0.0)
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
print((resident() - before) // 100)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_tables_that_a_simulation_does_not_use_take_no_memory(fmus: Path, tmp_path: Path) -> None:
    """In a process of its own: one that has freed memory gives that to its next instances, cleared by `calloc`."""
    size = record_layout(MODELS["Autopilot"].variables)[0].itemsize
    assert size > 90_000
    command = [sys.executable, "-c", MEMORY, str(fmus / "Autopilot.fmu"), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert 4_000 < int(done.stdout) < 0.35 * size


def test_foreign_and_damaged_states_are_refused(fmus: Path, compiled_plant: Path, tmp_path: Path) -> None:
    make = Factory(compiled_plant, tmp_path / "plant")
    data = serialized(make())
    other_make = Factory(fmus / "Quadrotor.fmu", tmp_path / "quadrotor")
    other = other_make()
    fmu = make()
    for at in range(0, len(data), 7):
        damaged = data[:at] + bytes([data[at] ^ 64]) + data[at + 1 :]
        with pytest.raises(FMICallException):
            fmu.deSerializeFMUstate(damaged)
        message = make.log.pop()
        assert ("are not a state of Plant" in message) if at < 37 else (message.endswith("the bytes are damaged")), at
        fmu.reset()
    for wrong in (serialized(other), data[:-1], data + b"\0", b""):
        with pytest.raises(FMICallException):
            fmu.deSerializeFMUstate(wrong)
        assert f"these {len(wrong)} bytes are not a state of Plant" in make.log.pop()
        fmu.reset()
    with pytest.raises(FMICallException):
        fmu.setFMUState(other.getFMUState())
    assert "fmi2SetFMUstate: this is not a state of Plant" in make.log.pop()


# -- packets ---------------------------------------------------------------------------------------------------------


def _some_text(chosen: np.random.Generator) -> str:
    """Returns base64 of up to 14 bytes, in half of the cases damaged."""
    text = list(base64.b64encode(chosen.bytes(int(chosen.integers(15)))).decode())
    if chosen.random() < 0.5:
        at, other = int(chosen.integers(len(text) + 1)), str(chosen.choice(list("A/+=9z -_\xfc\n")))
        text[at : at + int(chosen.integers(2))] = other * int(chosen.integers(2))
    return "".join(text)


def test_packets_are_the_text_that_python_accepts_strictly(compiled_plant: Path, tmp_path: Path) -> None:
    """Refused text changes nothing; up to the capacity of 10 bytes, all others are taken."""
    make = Factory(compiled_plant, tmp_path)
    fmu = make(initialise=False)
    (rx,) = [v.valueReference for v in make.description.modelVariables if v.name == "rx"]
    chosen, failures = np.random.default_rng(1), {"is not base64": 0, "holds 10 bytes, the text has more": 0}
    for _ in range(2000):
        fmu.reset()
        before, text = base64.b64encode(chosen.bytes(int(chosen.integers(11)))).decode(), _some_text(chosen)
        fmu.setString([rx], [before])
        try:
            data = binascii.a2b_base64(text.encode(), strict_mode=True)
        except binascii.Error:
            data = None
        if len(text) % 4 != 0:  # Python takes "AAAA=", too
            data = None
        if data is not None and len(data) <= 10:
            fmu.setString([rx], [text])
            fmu.setupExperiment(startTime=0.0)
            fmu.enterInitializationMode()
            assert fmu.getString([rx]) == [base64.b64encode(data)], text
            continue
        with pytest.raises(FMICallException):
            fmu.setString([rx], [text])
        assert fmu.getString([rx]) == [before.encode()], text
        (failure,) = [one for one in failures if one in make.log[-1]]
        failures[failure] += 1
        assert data is None or failure != "is not base64", text
        assert data is not None or failure == "is not base64" or len(text) > 14, text
    assert min(failures.values()) > 100


# -- other platforms ------------------------------------------------------------------------------------------------


def binaries_of(file: Path) -> dict[str, bytes]:
    with zipfile.ZipFile(file) as archive:
        return {n.removeprefix("binaries/"): archive.read(n) for n in archive.namelist() if n.startswith("binaries/")}


@pytest.mark.slow
def test_cross_builds(samples: SimpleNamespace, tmp_path: Path) -> None:
    targets = ["linux-x86_64", "linux-aarch64", "macos-aarch64"]
    built = build(samples.Plant, tmp_path, targets=targets)
    assert built.compiled
    binaries = binaries_of(built.file)
    assert sorted(binaries) == ["aarch64-darwin/Plant.dylib", "aarch64-linux/Plant.so", "linux64/Plant.so"]
    for name, machine in (("linux64/Plant.so", 62), ("aarch64-linux/Plant.so", 183)):
        assert struct.unpack_from("<HH", binaries[name], 16) == (3, machine)  # ET_DYN, EM_X86_64 or EM_AARCH64
        assert elf_symbols(binaries[name])[0] == EXPORTED
    assert_dylib(binaries["aarch64-darwin/Plant.dylib"], 0x0100000C)
    assert build(samples.Plant, tmp_path, targets=targets[::-1]).fresh
    assert build(samples.Plant, tmp_path, targets=["linux-x86_64"]).fresh  # and keeps the others


@pytest.mark.slow
@pytest.mark.skipif(
    "COSIM_TEST_ALL_TARGETS" not in os.environ,
    reason="zig compiles the Windows libraries for minutes the first time: COSIM_TEST_ALL_TARGETS=1 runs it",
)
def test_all_other_targets(samples: SimpleNamespace, tmp_path: Path) -> None:
    binaries = binaries_of(build(samples.Plant, tmp_path, targets=["windows-x86_64", "macos-x86_64"]).file)
    assert sorted(binaries) == ["darwin64/Plant.dylib", "win64/Plant.dll"]
    assert_dylib(binaries["darwin64/Plant.dylib"], 0x01000007)
    dll = binaries["win64/Plant.dll"]
    assert dll[:2] == b"MZ"
    (pe,) = struct.unpack_from("<I", dll, 60)
    assert dll[pe : pe + 6] == b"PE\0\0\x64\x86"
    assert struct.unpack_from("<H", dll, pe + 22)[0] & 0x2000  # IMAGE_FILE_DLL
    assert pe_exports(dll, pe) == EXPORTED


def assert_dylib(data: bytes, machine: int) -> None:
    magic, cpu, _, kind = struct.unpack_from("<IIII", data)
    assert (magic, cpu, kind) == (0xFEEDFACF, machine, 6)  # MH_DYLIB
    found = set(re.findall(rb"\0_((?:fmi2|uav_)\w+)\0", data.replace(b"\0", b"\0\0")))
    assert {name.decode() for name in found} >= EXPORTED


def pe_exports(data: bytes, pe: int) -> set[str]:
    """Names that a 64-bit DLL exports."""
    (count,) = struct.unpack_from("<H", data, pe + 6)
    (optional,) = struct.unpack_from("<H", data, pe + 20)
    sections = [struct.unpack_from("<IIII", data, pe + 24 + optional + 40 * i + 8) for i in range(count)]

    def offset(address: int) -> int:
        return next(address - va + raw for size, va, _, raw in sections if va <= address < va + size)

    table = offset(struct.unpack_from("<I", data, pe + 24 + 112)[0])
    (number,) = struct.unpack_from("<I", data, table + 24)
    names = offset(struct.unpack_from("<I", data, table + 32)[0])
    found = set()
    for i in range(number):
        at = offset(struct.unpack_from("<I", data, names + 4 * i)[0])
        found.add(data[at : data.index(0, at)].decode())
    return found
