"""What `build` writes and when; modelDescription.xml against FMPy; both builds of the sample models through FMPy."""

from __future__ import annotations

import base64
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import fmpy
import pytest
import pythonfmu
from fmpy.fmi1 import FMICallException, printLogMessage
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from lxml import etree

from cosim import Input, Model, Output
from cosim.build import HOST, TARGETS, Built, CannotCompile, build, build_all, load_models, models_of_package
from cosim.build.sources import sources_of
from tests.cosim.build.validation import faults
from tests.cosim.forked import Forked

MODELS = models_of_package("cosim_models")
INTERPRETED = tuple({m.__module__.split(".")[1]: m for m in MODELS if m.__name__ != "LargeAirspace"}.values())
"""A model of each room; pythonfmu imports all sources anew for each, and LargeAirspace differs from Airspace in numbers
of variables only, for which pythonfmu needs ten seconds."""
ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="session")
def interpreted_fmus(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("all_interpreted")
    for model in INTERPRETED:
        assert not build(model, folder, interpreted=True).compiled
    return folder


class Session:
    """One instance of an FMU through FMPy, with what it has logged."""

    def __init__(self, file: Path, folder: Path, name: str = "plant") -> None:
        self.log: list[tuple[int, str, str]] = []
        description = fmpy.read_model_description(str(file))
        self.vr = {v.name: v.valueReference for v in description.modelVariables}
        self.fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=fmpy.extract(str(file), str(folder)),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        self._callbacks = fmi2CallbackFunctions()
        self._callbacks.logger = fmi2CallbackLoggerTYPE(self._collect)
        self.fmu.instantiate(callbacks=self._callbacks, visible=True, loggingOn=True)

    def _collect(self, environment: Any, name: bytes, status: int, category: bytes | None, message: bytes) -> None:
        self.log.append((status, (category or b"").decode(), message.decode()))

    def initialise(self) -> None:
        self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def get(self, *names: str) -> list[Any]:
        result: list[Any] = []
        for name in names:
            kind = {"y": "Real", "x": "Real", "z[1]": "Real", "z[2]": "Real", "ready": "Boolean", "tx": "String"}
            (value,) = getattr(self.fmu, f"get{kind.get(name, 'Integer')}")([self.vr[name]])
            result.append(value.decode() if isinstance(value, bytes) else value)
        return result


@contextmanager
def instance(file: Path, folder: Path) -> Iterator[Session]:
    session = Session(file, folder)
    yield session
    session.fmu.freeInstance()


def text(packets: bytes) -> str:
    return base64.b64encode(packets).decode()


def printed(forked: Forked | None, code: str, *arguments: str, path: Path | None = None, **environment: str) -> str:
    """What a process of its own prints: a fork, or one that imports everything itself."""
    variables = {**os.environ, **environment}
    if forked is None:
        if path is not None:
            variables["PYTHONPATH"] = os.pathsep.join([str(path), os.environ.get("PYTHONPATH", "")])
        command = [sys.executable, "-c", code, *arguments]
        done = subprocess.run(command, env=variables, capture_output=True, text=True, check=False)
    else:
        done = forked.run(code, *arguments, paths=() if path is None else (path,), environment=variables)
    assert done.returncode == 0, done.stderr
    return done.stdout


# -- modelDescription.xml -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", [m.__name__ for m in MODELS])
def test_fmpy_finds_nothing_wrong(model: str, fmus: Path) -> None:
    assert faults(fmus / f"{model}.fmu") == []


@pytest.mark.parametrize("model", [m.__name__ for m in INTERPRETED])
def test_fmpy_finds_nothing_wrong_with_interpreted_fmus(model: str, interpreted_fmus: Path) -> None:
    assert faults(interpreted_fmus / f"{model}.fmu") == []


@pytest.mark.parametrize("model", [m.__name__ for m in INTERPRETED if m.kernels is not None])
def test_both_builds_describe_the_same(model: str, fmus: Path, interpreted_fmus: Path) -> None:
    compiled, interpreted = (read_xml(folder / f"{model}.fmu") for folder in (fmus, interpreted_fmus))
    assert compiled.find("CoSimulation").attrib.pop("needsExecutionTool") == "false"
    assert interpreted.find("CoSimulation").attrib.pop("needsExecutionTool") == "true"
    assert etree.tostring(compiled, method="c14n") == etree.tostring(interpreted, method="c14n")


# As FMPy reads them: it fills in the standard's default for the initial of inputs.
VARIABLES = """
y        output    continuous calculated -     Real        m
u        input     continuous exact      0.5   Real        m
w[1]     input     continuous exact      1.0   Real        -
w[2]     input     continuous exact      2.0   Real        -
w[3]     input     continuous exact      3.0   Real        -
count    input     discrete   exact      2     Integer     -
enable   input     discrete   exact      true  Boolean     -
gear     input     discrete   exact      2     Enumeration -
rx       input     discrete   exact      EMPTY String      -
x        local     continuous calculated -     Real        m
steps    local     discrete   calculated -     Integer     -
gain     parameter fixed      exact      2.0   Real        1/s
trim     parameter tunable    exact      0.0   Real        m
limit    parameter fixed      exact      100   Integer     -
fault    parameter tunable    exact      0     Enumeration -
names[1] parameter fixed      exact      true  Boolean     -
names[2] parameter fixed      exact      false Boolean     -
z[1]     output    continuous calculated -     Real        -
z[2]     output    continuous calculated -     Real        -
total    output    discrete   calculated -     Integer     -
ready    output    discrete   calculated -     Boolean     -
engaged  output    discrete   calculated -     Enumeration -
tx       output    discrete   calculated -     String      -
"""


def read_xml(file: Path) -> Any:
    with zipfile.ZipFile(file) as archive:
        return etree.fromstring(archive.read("modelDescription.xml"), etree.XMLParser(remove_blank_text=True))


def test_variables_of_the_description(plant: Path) -> None:
    described = fmpy.read_model_description(str(plant))
    rows = []
    for v in described.modelVariables:
        start = "EMPTY" if v.start == "" else v.start
        rows.append([x or "-" for x in (v.name, v.causality, v.variability, v.initial, start, v.type, v.unit)])
    assert rows == [line.split() for line in VARIABLES.strip().splitlines()]
    assert [v.valueReference for v in described.modelVariables] == list(range(23))


def test_rest_of_the_description(plant: Path, samples: SimpleNamespace) -> None:
    root = read_xml(plant)
    assert root.get("modelName") == "Plant"
    assert root.get("description") == "An integrator with every kind of variable."
    assert root.get("fmiVersion") == "2.0"
    assert dict(root.find("DefaultExperiment").attrib) == {"startTime": "0", "stepSize": "0.125"}
    assert root.find("ModelVariables/ScalarVariable").get("description") == 'position & "feed-through" < 5'
    flags = dict(root.find("CoSimulation").attrib)
    assert flags.pop("needsExecutionTool") in ("true", "false")
    assert flags == {
        "modelIdentifier": "Plant",
        "canHandleVariableCommunicationStepSize": "true",
        "canGetAndSetFMUstate": "true",
        "canSerializeFMUstate": "true",
        "canNotUseMemoryManagementFunctions": "true",
    }
    units = {u.get("name"): dict(u[0].attrib) for u in root.find("UnitDefinitions")}
    assert units == {"m": {"m": "1"}, "1/s": {"s": "-1"}}
    items = {t.get("name"): [(i.get("name"), i.get("value")) for i in t[0]] for t in root.find("TypeDefinitions")}
    assert items["Gear"] == [("park", "1"), ("slow", "2"), ("fast", "3")]
    assert sorted(items) == ["Fault", "Gear"]
    ports = [dict(port.attrib) for port in root.iter("PacketPort")]
    mime = "application/x-mavlink;version=2"
    assert ports == [
        {"variable": "rx", "mimeType": mime, "maxSize": "10"},
        {"variable": "tx", "mimeType": mime, "maxSize": "13"},
    ]
    limits = {v.get("name"): (v[0].get("min"), v[0].get("max")) for v in root.find("ModelVariables")}
    assert (limits["gain"], limits["limit"], limits["u"]) == (("0.0", "10.0"), ("1", "1000"), (None, None))


def test_structure_of_the_description(plant: Path) -> None:
    structure = read_xml(plant).find("ModelStructure")
    outputs = {int(u.get("index")): u.get("dependencies") for u in structure.find("Outputs")}
    assert outputs == {1: "2", 18: "3 4 5", 19: "3 4 5", 20: "6", 21: "7", 22: "8", 23: ""}
    initial = {int(u.get("index")): u.get("dependencies") for u in structure.find("InitialUnknowns")}
    parameters = "12 13 14 15 16 17"
    assert initial == {
        1: f"2 {parameters}",
        18: f"3 4 5 {parameters}",
        19: f"3 4 5 {parameters}",
        20: f"6 {parameters}",
        21: f"7 {parameters}",
        22: f"8 {parameters}",
        23: parameters,
    }


@pytest.mark.parametrize(
    ("attributes", "message"),
    [
        ({"__doc__": "", "step_size": 1.0, "variables": (Input("u"),)}, "Odd: a model needs a docstring, a step_size"),
        ({"__doc__": "A model.", "variables": (Input("u"),)}, "Odd: a model needs a docstring, a step_size > 0"),
        ({"__doc__": "A model.", "step_size": 1.0}, "Odd: a model needs .* variables"),
        (
            {"__doc__": "A model.", "step_size": 1.0, "variables": (Output("y", unit="parsec"),), "do_step": print},
            "^Odd: variable y: unit 'parsec': 'parsec' is not one of",
        ),
    ],
)
@pytest.mark.parametrize("interpreted", [False, True])
def test_wrong_descriptions(
    attributes: dict[str, Any], message: str, interpreted: bool, samples: SimpleNamespace, tmp_path: Path
) -> None:
    odd = type("Odd", (Model,), {**attributes, "__module__": samples.Plant.__module__})
    odd.__doc__ = attributes["__doc__"]
    with pytest.raises(ValueError, match=message):
        build(odd, tmp_path, interpreted=interpreted)
    assert list(tmp_path.iterdir()) == []


# -- when something is built ----------------------------------------------------------------------------------------


def digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def test_several_are_built_at_a_time_and_come_in_their_order(tmp_path: Path) -> None:
    chosen = [m for m in models_of_package("cosim_models") if m.__name__ in ("Hexarotor", "LineAgent", "Quadrotor")]
    built = list(build_all(chosen, tmp_path, interpreted=True))
    assert [one.file.name for one in built] == ["Hexarotor.fmu", "LineAgent.fmu", "Quadrotor.fmu"]
    assert not any(one.fresh for one in built)
    (alone,) = build_all(chosen[:1], tmp_path / "alone", interpreted=True)
    assert alone.file.read_bytes() == built[0].file.read_bytes()
    built[1].file.unlink()
    assert [one.fresh for one in build_all(chosen, tmp_path, interpreted=True)] == [True, False, True]
    with pytest.raises(ValueError, match="target vax: not available; valid: "):
        list(build_all(chosen, tmp_path / "other", targets=["vax"]))


def test_a_program_without_a_guard_builds_several(tmp_path: Path) -> None:
    """The processes that build do not run the program again, which only calls something that builds."""
    program = tmp_path / "program.py"
    program.write_text(
        "from pathlib import Path\nfrom cosim.build import build_all, models_of_package\n"
        "chosen = [m for m in models_of_package('cosim_models') if m.__name__ in ('Hexarotor', 'Quadrotor')]\n"
        "print(*(one.file.name for one in build_all(chosen, Path('fmus'), interpreted=True)), __file__)\n"
    )
    done = subprocess.run([sys.executable, program], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.stderr == ""
    assert done.stdout.split() == ["Hexarotor.fmu", "Quadrotor.fmu", str(program)]


@pytest.fixture
def resources_of_an_fmu(tmp_path: Path) -> Iterator[Path]:
    """First on the path, as pythonfmu's wrapper leaves them there: an FMU's own pythonfmu, and a cosim of its own."""
    folder = tmp_path / "resources"
    folder.mkdir()
    shutil.copytree(Path(pythonfmu.__file__).parent, folder / "pythonfmu", ignore=shutil.ignore_patterns("resources"))
    (folder / "cosim.py").write_text("raise ImportError('of an FMU')\n")
    (folder / "slavemodule.txt").write_text("slave")
    sys.path.insert(0, str(folder))
    yield folder
    sys.path.remove(str(folder))


def test_processes_that_build_import_nothing_from_loaded_fmus(resources_of_an_fmu: Path, tmp_path: Path) -> None:
    chosen = [m for m in models_of_package("cosim_models") if m.__name__ in ("Hexarotor", "Quadrotor")]
    for built in build_all(chosen, tmp_path, interpreted=True):
        with zipfile.ZipFile(built.file) as archive:
            assert f"binaries/linux64/{built.file.stem}.so" in archive.namelist()
    assert sys.path[0] == str(resources_of_an_fmu)


def test_an_interpreted_fmu_without_a_binary_is_an_error(resources_of_an_fmu: Path, tmp_path: Path) -> None:
    """The process has imported pythonfmu from an FMU."""
    code = (
        f"import sys; sys.path.insert(0, {str(resources_of_an_fmu)!r}); import pythonfmu; del sys.path[0]\n"
        "from pathlib import Path\nfrom cosim.build import build, load_models\n"
        "model = load_models('cosim_models.vehicles.hexarotor')[0]\n"
        f"build(model, Path({str(tmp_path / 'fmus')!r}), interpreted=True)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    found = resources_of_an_fmu / "pythonfmu"
    assert done.stderr.splitlines()[-1] == (
        f"RuntimeError: Hexarotor: the pythonfmu in {found} has no binaries: an FMU that this process has loaded "
        "brought it along; import cosim.build before that, or build in another process"
    )
    assert not list((tmp_path / "fmus").glob("*.fmu"))


def test_only_what_changed_is_built(samples: SimpleNamespace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plant, file = samples.Plant, tmp_path / "Plant.fmu"
    monkeypatch.delenv("CC", raising=False)
    assert build(plant, tmp_path) == Built(file, compiled=True, fresh=False)
    first = digest(file)
    assert build(plant, tmp_path) == Built(file, compiled=True, fresh=True)
    file.unlink()
    assert build(plant, tmp_path) == Built(file, compiled=True, fresh=False)
    assert digest(file) == first  # the same sources give the same bytes
    file.write_bytes(file.read_bytes()[:1000])
    assert build(plant, tmp_path) == Built(file, compiled=True, fresh=False)
    assert digest(file) == first
    assert build(plant, tmp_path, interpreted=True) == Built(file, compiled=False, fresh=False)
    second = digest(file)
    assert build(plant, tmp_path, interpreted=True) == Built(file, compiled=False, fresh=True)
    file.unlink()
    build(plant, tmp_path, interpreted=True)
    assert digest(file) == second
    assert build(plant, tmp_path) == Built(file, compiled=True, fresh=False)
    assert digest(file) == first
    assert [path.name for path in tmp_path.iterdir()] == ["Plant.fmu"]


def test_the_tools_belong_to_what_is_up_to_date(
    samples: SimpleNamespace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    build(samples.Plant, tmp_path, interpreted=True)
    monkeypatch.setattr("cosim.build.version", lambda name: "99.0" if name == "numba" else "1")
    assert not build(samples.Plant, tmp_path, interpreted=True).fresh
    assert build(samples.Plant, tmp_path, interpreted=True).fresh


def test_unknown_target(samples: SimpleNamespace, tmp_path: Path) -> None:
    with pytest.raises(
        ValueError, match=r"target amiga, linux-mips: not available; valid: linux-x86_64, linux-aarch64, windows-"
    ):
        build(samples.Plant, tmp_path, targets=["linux-mips", HOST, "amiga"])


def test_cc_is_used(samples: SimpleNamespace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = tmp_path / "calls"
    compiler = tmp_path / "my cc"
    zig = f'"{sys.executable}" -m ziglang cc -target {TARGETS[HOST].zig} -rtlib=none'
    compiler.write_text(f'#!/bin/sh\necho "$@" >> "{calls}"\nexec {zig} "$@"\n')
    compiler.chmod(0o755)
    monkeypatch.setenv("CC", f"'{compiler}' -DFROM_CC")
    built = build(samples.Plant, tmp_path / "out")
    assert built.compiled
    assert calls.read_text().startswith("-DFROM_CC ")
    assert build(samples.Plant, tmp_path / "out").fresh
    monkeypatch.delenv("CC")
    assert not build(samples.Plant, tmp_path / "out").fresh
    assert len(calls.read_text().splitlines()) == 1


@pytest.mark.parametrize(
    ("compiler", "message"),
    [
        ("/nowhere/cc", "Plant: the C compiler /nowhere/cc cannot be run: No such file or directory"),
        (f"{sys.executable} -c 'import sys; sys.exit(\"out of order\")'", r"Plant: .* failed:\nout of order"),
        ("it's", 'Plant: the quotes of CC="it\'s" do not match'),
    ],
)
def test_compiler_out_of_order(
    compiler: str, message: str, samples: SimpleNamespace, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CC", compiler)
    with pytest.raises(RuntimeError, match=message):
        build(samples.Plant, tmp_path)
    assert list(tmp_path.iterdir()) == []


def line_of(text: str) -> int:
    """The first line of sample_models.py with `text`."""
    lines = (Path(__file__).parents[1] / "sample_models.py").read_text().splitlines()
    return next(i for i, line in enumerate(lines, start=1) if text in line)


@pytest.mark.parametrize(
    ("model", "at", "reason"),
    [
        (
            "Allocates",
            "m.y = np.full(3, t).sum()",
            "np.full creates an array, which a kernel cannot: declare a Memory",
        ),
        ("Borrows", "def borrow(", "needs numba_frexp, which only a Python process has"),
        ("Attribute", "return x.nothing", "Unknown attribute 'nothing' of type float64"),
        ("Forgetful", "    m.y = t", "forgetful returns 0, or a key of errors: end it with return 0"),
        ("Misspelt", "m.yy = t", 'no variable "yy" in Misspelt; did you mean "y"?'),
        ("Plain", "def plain(", "plain is not a kernel: write @kernel above its def"),
    ],
)
@pytest.mark.parametrize("checked", [True, False])
def test_kernels_that_cannot_be_compiled_are_an_error(
    model: str, at: str, reason: str, checked: bool, samples: SimpleNamespace, tmp_path: Path
) -> None:
    file = Path(__file__).parents[1] / "sample_models.py"
    shown = os.path.relpath(file)
    line = max(
        i
        for i, text in enumerate(file.read_text().splitlines(), start=1)
        if at in text and (model != "Forgetful" or i < line_of("def misspelt("))
    )
    with pytest.raises(CannotCompile) as failed:
        build(getattr(samples, model), tmp_path, checked=checked)
    places = [f"{model}: {shown}:{line - d}: {reason}" for d in (0, 1)]  # of a function, its decorator
    assert str(failed.value) in places
    assert list(tmp_path.iterdir()) == []


def test_a_plain_function_runs_interpreted_where_that_is_asked_for(samples: SimpleNamespace, tmp_path: Path) -> None:
    plain = build(samples.Plain, tmp_path, interpreted=True)
    assert not plain.compiled
    result = fmpy.simulate_fmu(str(plain.file), stop_time=1.0, output_interval=0.25)
    assert list(result["y"]) == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])


def test_without_numbas_compiler_nothing_is_compiled(tmp_path: Path, forked_importer: Forked) -> None:
    code = """
import sys
from pathlib import Path
from cosim.build import CannotCompile, build, load_models
built = {m.__name__: m for m in load_models(sys.argv[1])}
try:
    build(built["Plant"], Path(sys.argv[2]))
except CannotCompile as error:
    print(error)
"""
    samples = Path(__file__).parents[1] / "sample_models.py"
    told = printed(forked_importer, code, str(samples), str(tmp_path), NUMBA_DISABLE_JIT="1")
    assert told == "numba's compiler is switched off (NUMBA_DISABLE_JIT): unset it, or build with --interpreted\n"


# -- sources --------------------------------------------------------------------------------------------------------

GARDEN = {
    "garden/__init__.py": "",
    "garden/law.py": """from garden.deep import constants
from cosim import kernel


@kernel
def law(x):
    return 2.0 * x
""",
    "garden/deep/__init__.py": "",
    "garden/deep/constants.py": "LIMIT = 1.0\n",
    "garden/unused.py": "",
    "garden/bed.py": '''"""A bed."""
from cosim import Model, Output, kernel
from garden.law import law


@kernel
def start(m):
    m.y = 1.0
    return 0


@kernel
def advance(m, t, h):
    m.y = law(m.y)
    return 0


class Bed(Model):
    """Grows."""

    step_size = 1.0
    variables = (Output("y"),)
    kernels = (start, advance)
''',
}
BUILD_BED = """
import json, sys
from pathlib import Path
from cosim.build import build, load_models
(bed,) = load_models("garden.bed")
built = build(bed, Path(sys.argv[1]), interpreted=sys.argv[2] == "interpreted")
from fmpy import read_model_description
print(json.dumps([built.fresh, built.compiled, read_model_description(str(built.file)).guid]))
"""


class Garden:
    """A package in a folder of its own, built by processes of their own."""

    def __init__(self, folder: Path, forked: Forked | None) -> None:
        self.folder, self.forked = folder, forked
        self._written = time.time() - 3600.0
        for name, text in GARDEN.items():
            self.write(name, text)

    def write(self, name: str, text: str) -> None:
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        # Python compares its kept bytecode with the size and the second of a file.
        self._written += 2.0
        os.utime(path, (self._written, self._written))

    def build(self, out: Path, how: str = "compiled") -> tuple[bool, bool, str]:
        fresh, compiled, guid = json.loads(printed(self.forked, BUILD_BED, str(out), how, path=self.folder))
        return fresh, compiled, guid


def test_guid_and_freshness_follow_the_sources(tmp_path: Path, forked_builder: Forked) -> None:
    garden, out = Garden(tmp_path / "a", forked_builder), tmp_path / "out"
    fresh, compiled, first = garden.build(out, "interpreted")
    assert (fresh, compiled) == (False, False)
    with zipfile.ZipFile(out / "Bed.fmu") as archive:
        names = {n for n in archive.namelist() if n.startswith("resources/garden/")}
    assert names == {f"resources/{name}" for name in GARDEN if name != "garden/unused.py"}

    garden.write("garden/unused.py", "# of no consequence")
    assert garden.build(out, "interpreted") == (True, False, first)

    elsewhere = Garden(tmp_path / "b", None)  # its GUID does not depend on the hash seed either
    for path in (tmp_path / "b").rglob("*.py"):
        os.utime(path, (1e9, 1e9))
    assert elsewhere.build(tmp_path / "other", "compiled") == (False, True, first)

    garden.write("garden/deep/constants.py", "LIMIT = 1.0  # a comment\n")
    fresh, _, second = garden.build(out, "interpreted")
    assert not fresh
    assert second != first
    garden.write("garden/deep/constants.py", GARDEN["garden/deep/constants.py"])
    assert garden.build(out, "interpreted") == (False, False, first)


def test_a_changed_callee_is_compiled_anew(tmp_path: Path, forked_builder: Forked) -> None:
    garden, out = Garden(tmp_path, forked_builder), tmp_path / "out"
    garden.build(out)
    final = {}
    for factor in ("2.0", "3.0"):
        garden.write("garden/law.py", GARDEN["garden/law.py"].replace("2.0", factor))
        garden.build(out)
        result = fmpy.simulate_fmu(str(out / "Bed.fmu"), stop_time=3.0, step_size=1.0, output_interval=1.0)
        final[factor] = list(result["y"])
    assert final == {"2.0": [1.0, 2.0, 4.0, 8.0], "3.0": [1.0, 3.0, 9.0, 27.0]}


@pytest.mark.slow
def test_bytes_do_not_depend_on_the_process_or_its_cache(tmp_path: Path, forked_builder: Forked) -> None:
    garden = Garden(tmp_path / "garden", None)
    digests = set()
    for i, extra in enumerate(("", "import cosim_models.vehicles.quadrotor\n")):
        garden.write("sitecustomize.py", extra)  # other kernels compiled or loaded before
        shutil.rmtree(tmp_path / "out", ignore_errors=True)
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("XDG_CACHE_HOME", str(tmp_path / f"cache{i}"))
            garden.forked = None
            garden.build(tmp_path / "out")
            digests.add(digest(tmp_path / "out" / "Bed.fmu"))
            shutil.rmtree(tmp_path / "out")
            garden.forked = forked_builder
            garden.build(tmp_path / "out")  # its object code from the cache now
            digests.add(digest(tmp_path / "out" / "Bed.fmu"))
            shutil.rmtree(tmp_path / "out")
            shutil.rmtree(tmp_path / f"cache{i}" / "uav-cosim" / "objects")
            assert list((tmp_path / f"cache{i}").rglob("*.lowered"))
            garden.build(tmp_path / "out")  # made of the IR in the cache
            digests.add(digest(tmp_path / "out" / "Bed.fmu"))
    assert len(digests) == 1


RUN_TWO = """
import sys
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
keep = []
for file in sys.argv[1:]:
    d = read_model_description(file)
    fmu = FMU2Slave(guid=d.guid, unzipDirectory=extract(file), modelIdentifier="Bed", instanceName="bed")
    callbacks = fmi2CallbackFunctions()
    callbacks.logger = fmi2CallbackLoggerTYPE(lambda *a: print("LOG", a[4].decode()))
    keep.append((fmu, callbacks))
    try:
        fmu.instantiate(callbacks=callbacks, loggingOn=True)
        fmu.setupExperiment(startTime=0.0)
        fmu.enterInitializationMode()
        fmu.exitInitializationMode()
        fmu.doStep(0.0, 1.0)
        print("RAN", *fmu.getReal([0]))
    except Exception as error:
        print("FAILED", error)
import os
sys.stdout.flush()
os._exit(0)
"""


def test_two_versions_of_a_module_never_mix(tmp_path: Path, forked_builder: Forked, forked_importer: Forked) -> None:
    garden = Garden(tmp_path / "garden", forked_builder)
    garden.build(tmp_path / "one", "interpreted")
    garden.write("garden/law.py", GARDEN["garden/law.py"].replace("2.0", "3.0"))
    garden.build(tmp_path / "two", "interpreted")
    one, two = (str(tmp_path / name / "Bed.fmu") for name in ("one", "two"))
    assert printed(forked_importer, RUN_TWO, one, two) == "RAN 2.0\nRAN 3.0\n"
    assert printed(forked_importer, RUN_TWO, two, one) == "RAN 3.0\nRAN 2.0\n"
    assert printed(forked_importer, RUN_TWO, one, one) == "RAN 2.0\nRAN 2.0\n"


def test_numba_compiles_nothing_of_an_interpreted_fmu(tmp_path: Path, forked_builder: Forked) -> None:
    """Even where it is loaded, and the same modules are, with their kernels compiled."""
    garden = Garden(tmp_path / "garden", forked_builder)
    garden.build(tmp_path / "out", "interpreted")
    look = """
assert "numba" in sys.modules and type(sys.modules["cosim.fields"].get_real).__name__ == "Kernel"
(entry,) = [module for name, module in sys.modules.items() if name.startswith("cosim_fmu_bed_")]
kernel = entry.Bed.kernels[1]
print(type(kernel).__name__, type(kernel.__globals__["law"]).__name__)
import os
"""
    code = "import cosim.fields\n" + RUN_TWO.replace("\nimport os\n", look)
    assert printed(forked_builder, code, str(tmp_path / "out" / "Bed.fmu")) == "RAN 2.0\nfunction function\n"


def test_closure_of_a_model(samples: SimpleNamespace) -> None:
    sources = sources_of(samples.Plant)
    assert set(sources.files) == {
        "sample_models",
        "cosim",
        "cosim.deferred",
        "cosim.folding",
        "cosim.kept",
        "cosim.kernel",
        "cosim.lowering",
        "cosim.model",
        "cosim.shortcuts",
        "cosim.verdict",
    }
    assert sources.packages == {"cosim"}
    assert sources.digests["cosim.kernel"] == digest(ROOT / "cosim" / "kernel.py")
    assert sources.guid("Plant") == sources_of(samples.Text).guid("Plant") != sources.guid("Text")


def test_relative_imports_are_refused(tmp_path: Path, forked_builder: Forked) -> None:
    garden = Garden(tmp_path, forked_builder)
    garden.write("garden/bed.py", GARDEN["garden/bed.py"].replace("from garden.law", "from .law"))
    with pytest.raises(
        AssertionError, match=r"garden/bed.py:3: write absolute imports; an FMU's modules are top-level"
    ):
        garden.build(tmp_path / "out")


# -- finding models -------------------------------------------------------------------------------------------------


def test_models_of_a_package() -> None:
    names = [model.__name__ for model in MODELS]
    assert names == sorted(names)
    assert {"Quadrotor", "Hexarotor", "LineAgent"} <= set(names)
    assert [m.__name__ for m in load_models("cosim_models.vehicles.quadrotor")] == ["Quadrotor"]
    with pytest.raises(ImportError, match="no_such_package"):
        models_of_package("no_such_package")


def test_a_place_that_cannot_be_written(samples: SimpleNamespace, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for interpreted in (False, True):
        with pytest.raises(RuntimeError, match=rf"^{tmp_path}/file/fmus: cannot be written: Not a directory$"):
            build(samples.Plant, tmp_path / "file" / "fmus", interpreted=interpreted)


def test_load_models_of_nothing(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"nowhere.py: no such file"):
        load_models(str(tmp_path / "nowhere.py"))
    with pytest.raises(ValueError, match=r"cosim_models.nowhere: no such module"):
        load_models("cosim_models.nowhere")
    with pytest.raises(ValueError, match=r"no_such_package.module: no such module"):
        load_models("no_such_package.module")
    for no_module in (".", "fmus/Quadrotor.fmu"):
        with pytest.raises(ValueError, match=rf"^{no_module}: no such module; give a \.py file"):
            load_models(no_module)
    with pytest.raises(ValueError, match=r"cosim.frames: it defines no subclass of cosim.Model"):
        load_models("cosim.frames")
    with pytest.raises(ValueError, match=r"sample_models.py: a module called sample_models is already loaded"):
        load_models(str(Path(__file__).parents[1] / "sample_models.py")) and load_models(
            str(Path(__file__).parents[1] / "sample_models.py")
        )


def test_a_file_that_fails_can_be_loaded_again_when_mended(tmp_path: Path) -> None:
    file = tmp_path / "mended_model.py"
    file.write_text("import cosim.no_such_thing\n")
    with pytest.raises(ModuleNotFoundError, match=r"mended_model\.py:1: No module named 'cosim\.no_such_thing'"):
        load_models(str(file))
    for text, message in (
        ("from cosim import Model\n\nx = Input('u')\n", "3: NameError: name 'Input' is not defined"),
        ("from cosim import Modle\n", r"1: cannot import name 'Modle' from 'cosim'"),
        ("def start(m)\n    return 0\n", "1: expected ':'"),
        ("x = [1][2]\n", "1: IndexError: list index out of range"),
    ):
        file.write_text(text)
        with pytest.raises((ValueError, ImportError), match=rf"mended_model\.py:{message}"):
            load_models(str(file))
    file.write_text("from cosim import Model\nclass Mended(Model): 'Fine.'\n")
    assert [m.__name__ for m in load_models(str(file))] == ["Mended"]
    del sys.modules["mended_model"]


BIDDER = """\
import bid_tools.limits
from bid_messages import BID, double
from cosim import Model, Output, kernel


@kernel
def start(m):
    return 0


@kernel
def advance(m, t, h):
    m.y = double(BID) + bid_tools.limits.LIMIT
    return 0


class Bidder(Model):
    'Bids.'
    step_size = 1.0
    variables = (Output("y"),)
    kernels = (start, advance)
"""
BESIDE = {
    "bidder.py": BIDDER,
    "bid_messages.py": "from cosim import kernel\nBID = 5.0\n@kernel\ndef double(x):\n    return 2.0 * x\n",
    "bid_tools/__init__.py": "",
    "bid_tools/limits.py": "LIMIT = 0.5\n",
    "bid_tools/unused.py": "",
}


@pytest.fixture
def beside(tmp_path: Path) -> Iterator[Path]:
    """A file of models with modules beside it; what a test loads of them is forgotten afterwards."""
    before, path = set(sys.modules), list(sys.path)
    folder = tmp_path / "beside"
    for name, text in BESIDE.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    yield folder
    left = str(folder) in sys.path
    sys.path[:] = path  # pythonfmu puts the resources of FMUs on it
    assert not left
    for name in {name for name in set(sys.modules) - before if name.startswith(("bid", "own_"))}:
        del sys.modules[name]


def forget_bidder() -> None:
    for name in [name for name in sys.modules if name.startswith("bid")]:
        del sys.modules[name]


@pytest.mark.parametrize("interpreted", [False, True])
@pytest.mark.parametrize("in_package", [False, True])
def test_modules_beside_a_file_of_models_are_found_and_are_its_sources(
    beside: Path, interpreted: bool, in_package: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also in a folder that is a package: its kernels must not be kept by what the package imports."""
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # its date is to the second only
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    if in_package:
        (beside / "__init__.py").write_text("")
    for bid, y in (("5.0", 10.5), ("6.0", 12.5)):
        (beside / "bid_messages.py").write_text(BESIDE["bid_messages.py"].replace("5.0", bid))
        for fresh in (False, True):
            forget_bidder()
            (bidder,) = load_models(str(beside / "bidder.py"))
            assert {n for n in sources_of(bidder).files if not n.startswith("cosim")} == {
                *("bidder", "bid_messages", "bid_tools", "bid_tools.limits"),
            }
            built = build(bidder, tmp_path / "fmus", interpreted=interpreted)
            assert (built.fresh, built.compiled) == (fresh, not interpreted)
        forget_bidder()
        result = fmpy.simulate_fmu(str(built.file), stop_time=1.0, step_size=1.0, output_interval=1.0)
        assert list(result["y"]) == [0.0, y]


def test_files_of_models_may_import_each_other(beside: Path) -> None:
    (beside / "bid_own.py").write_text("from bidder import Bidder\nclass Own(Bidder): 'Bids.'\n")
    assert [m.__name__ for m in load_models(str(beside / "bid_own.py"))] == ["Own"]
    assert [m.__name__ for m in load_models(str(beside / "bidder.py"))] == ["Bidder"]
    with pytest.raises(ValueError, match="a module called bidder is already loaded; rename the file"):
        load_models(str(beside / "bidder.py"))


def test_a_module_of_the_name_of_one_beside_that_is_loaded(beside: Path, tmp_path: Path) -> None:
    other = tmp_path / "other" / "bid_messages.py"
    other.parent.mkdir()
    other.write_text("from cosim import Model\nclass Other(Model): 'Other.'\n")
    load_models(str(other))
    for _ in range(2):
        with pytest.raises(ValueError) as caught:
            load_models(str(beside / "bidder.py"))
        text = f"it imports bid_messages, but that of {other} is already loaded; rename that beside it"
        assert str(caught.value) == f"{beside / 'bidder.py'}: {text}"


def test_a_checkout_beside_a_file_of_models_is_not_what_it_imports(beside: Path) -> None:
    (beside / "cosim").mkdir()
    (beside / "cosim" / "__init__.py").write_text("")
    (bidder,) = load_models(str(beside / "bidder.py"))
    assert sources_of(bidder).files["cosim"] == ROOT / "cosim" / "__init__.py"


def test_a_module_beside_that_fails_is_told_with_its_line_and_can_be_mended(beside: Path) -> None:
    for text, message in (
        ("BID = 5.0\ndouble = lost\n", "2: NameError: name 'lost' is not defined"),
        ("def double(\n", "1: '(' was never closed"),
    ):
        (beside / "bid_messages.py").write_text(text)
        with pytest.raises(ValueError, match=rf"bid_messages\.py:{re.escape(message)}"):
            load_models(str(beside / "bidder.py"))
    (beside / "bid_messages.py").write_text(BESIDE["bid_messages.py"])
    assert [m.__name__ for m in load_models(str(beside / "bidder.py"))] == ["Bidder"]


# -- both builds through FMPy ---------------------------------------------------------------------------------------


def test_trajectory_by_hand(plant: Path) -> None:
    result = fmpy.simulate_fmu(
        str(plant),
        stop_time=1.0,
        step_size=0.5,
        output_interval=0.5,
        start_values={"gain": 4.0, "count": 3, "limit": 7, "trim": 0.25, "enable": False, "gear": 3, "w[3]": -1.5},
        output=["x", "y", "steps", "total", "z[1]", "z[2]", "ready", "engaged"],
    )
    assert [row.item() for row in result] == [
        (0.0, 12.0, 10.0, 3.0, -1.5, 1, 21, 3, False),
        (0.5, 13.25, 11.25, 3.0, -1.5, 2, 21, 3, False),
        (1.0, 14.5, 12.5, 3.0, -1.5, 3, 21, 3, False),
    ]
    assert result.dtype.names == ("time", "y", "x", "z[1]", "z[2]", "steps", "total", "engaged", "ready")


def test_packets_through_fmpy(plant: Path, tmp_path: Path) -> None:
    with instance(plant, tmp_path) as one:
        one.initialise()
        assert one.get("tx") == [""]
        one.fmu.setString([one.vr["rx"]], [text(b"\x00\x80\xff")])
        one.fmu.doStep(0.0, 0.125)
        assert one.get("tx") == [text(b"\xff\x80\x00\x02")]
        one.fmu.setString([one.vr["rx"]], [""])
        one.fmu.doStep(0.125, 0.125)
        assert one.get("tx") == [text(b"\x03")]


def test_reset_starts_again(plant: Path, tmp_path: Path) -> None:
    with instance(plant, tmp_path) as one:
        for _ in range(2):
            one.initialise()
            assert one.get("y", "x", "steps") == [11.0, 10.0, 1]
            one.fmu.setReal([one.vr["trim"]], [5.0])
            one.fmu.doStep(0.0, 0.125)
            assert one.get("x", "steps") == [15.125, 2]
            one.fmu.reset()


def test_state_through_fmpy(plant: Path, tmp_path: Path) -> None:
    with instance(plant, tmp_path) as one:
        one.initialise()
        one.fmu.setString([one.vr["rx"]], [text(b"abc")])
        one.fmu.doStep(0.0, 0.125)
        state = one.fmu.getFMUState()
        one.fmu.doStep(0.125, 0.125)
        expected = one.get("x", "y", "steps", "tx")
        one.fmu.setReal([one.vr["u"]], [9.0])
        one.fmu.doStep(0.25, 0.125)
        one.fmu.setFMUState(state)
        one.fmu.doStep(0.125, 0.125)
        assert one.get("x", "y", "steps", "tx") == expected == [10.25, 11.25, 3, text(b"cba\x03")]
        one.fmu.setFMUState(state)
        one.fmu.freeFMUState(state)
        assert one.get("steps") == [2]


FAIL = """
import json, os, sys
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
file, settings = sys.argv[1], json.loads(sys.argv[2])
d = read_model_description(file)
variables = {v.name: v for v in d.modelVariables}
fmu = FMU2Slave(guid=d.guid, unzipDirectory=extract(file), modelIdentifier=d.modelName, instanceName="one")
callbacks, log = fmi2CallbackFunctions(), []
callbacks.logger = fmi2CallbackLoggerTYPE(lambda *a: log.append([a[2], a[4].decode()]))
fmu.instantiate(callbacks=callbacks, visible=True, loggingOn=True)
fmu.setupExperiment(startTime=0.0)
error = None
try:
    for name, value in settings.items():
        if variables[name].type == "String":
            fmu.setString([variables[name].valueReference], [value])
        else:
            fmu.setInteger([variables[name].valueReference], [value])
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    fmu.doStep(0.0, 0.125)
except Exception as e:
    error = str(e)
print(json.dumps([error, log]))
sys.stdout.flush()
os._exit(0)  # after fmi2Fatal, which is what pythonfmu makes of an exception, nothing may be called
"""


def fail(forked: Forked, file: Path, **settings: Any) -> tuple[str | None, list[tuple[int, str]]]:
    """What the first failing call of an instance in a process of its own says, and what was logged."""
    error, log = json.loads(printed(forked, FAIL, str(file), json.dumps(settings)))
    return error, [tuple(entry) for entry in log]


RAISED = "sample_models.py:{}: ValueError: the kernel does not {}"


@pytest.mark.parametrize(
    ("fault", "what", "compiled"),
    [
        (1, "ExitInitializationMode", 'start: the plant is "broken" by 100 %% of \\ faults (code 7)'),
        (2, "DoStep", 'advance: the plant is "broken" by 100 %% of \\ faults (code 7)'),
        (3, "DoStep", "advance returned 99; it returns 0, or a key of errors (7)"),
        (4, "ExitInitializationMode", f"start: {RAISED.format(54, 'start')}"),
        (5, "DoStep", f"advance: {RAISED.format(70, 'advance')}"),
    ],
)
def test_faults_reach_the_logger(
    forked_importer: Forked, compiled_plant: Path, fault: int, what: str, compiled: str
) -> None:
    assert fail(forked_importer, compiled_plant, fault=fault) == (
        f"fmi2{what} failed with status 3 (error).",
        [(3, compiled)],
    )


@pytest.mark.parametrize(
    ("fault", "line", "interpreted"),
    [
        (1, "", 'start: the plant is "broken" by 100 % of \\ faults (code 7)'),
        (2, "", 'advance: the plant is "broken" by 100 % of \\ faults (code 7)'),
        (3, "", "advance returned 99; it returns 0, or a key of errors (7)"),
        (4, 'raise ValueError("the kernel does not start")', "ValueError: the kernel does not start"),
        (5, 'raise ValueError("the kernel does not advance")', "ValueError: the kernel does not advance"),
    ],
)
def test_tracebacks_reach_the_logger(
    forked_importer: Forked, interpreted_plant: Path, fault: int, line: str, interpreted: str
) -> None:
    error, log = fail(forked_importer, interpreted_plant, fault=fault)
    assert error is not None
    assert error.endswith("failed with status 4 (fatal).")
    status, message = log[0]
    assert status == 3
    if not line:
        assert message.rstrip() == f"Plant: {interpreted}"
    else:
        assert message.startswith(
            f"Plant: sample_models.py:{line_of(line)}: {interpreted}\nTraceback (most recent call "
        )
        assert message.rstrip().endswith(interpreted)
        assert f'sample_models.py", line {line_of(line)}, in ' in message


def test_traceback_of_a_step_of_ones_own(forked_importer: Forked, samples: SimpleNamespace, tmp_path: Path) -> None:
    _, log = fail(forked_importer, build(samples.Text, tmp_path).file, greeting="fail")
    assert log[0][1].rstrip().endswith("RuntimeError: told to fail")
    assert f'sample_models.py", line {line_of("told to fail")}, in do_step' in log[0][1]


def test_faults_are_visible_without_a_logger_of_ones_own(
    compiled_plant: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(FMICallException):
        fmpy.simulate_fmu(str(compiled_plant), stop_time=1.0, start_values={"fault": 2}, logger=printLogMessage)
    captured = capfd.readouterr()
    assert "the plant is" in captured.out + captured.err


def test_strings_through_fmpy(samples: SimpleNamespace, tmp_path: Path) -> None:
    built = build(samples.Text, tmp_path)
    assert not built.compiled
    with instance(built.file, tmp_path / "x") as one:
        one.fmu.setString([one.vr["mark"]], ["?"])
        one.initialise()
        assert one.fmu.getString([one.vr["answer"]]) == [b"nothing yet?"]
        one.fmu.setString([one.vr["greeting"]], ["good morning"])
        one.fmu.doStep(0.0, 0.5)
        assert one.fmu.getString([one.vr["answer"]]) == [b"good morning at 0.5?"]
        assert one.get("y") == [0.0]


def test_an_interpreted_fmu_gives_the_same_without_jit(
    forked_importer: Forked, interpreted_plant: Path, compiled_plant: Path
) -> None:
    code = """
import sys, fmpy
r = fmpy.simulate_fmu(sys.argv[1], stop_time=1.0, output=["x", "y", "steps", "total", "z[1]", "ready", "engaged"])
print(r.tobytes().hex())
import os; sys.stdout.flush(); os._exit(0)
"""
    runs = {
        printed(forked_importer, code, str(interpreted_plant), NUMBA_DISABLE_JIT="1"),
        printed(forked_importer, code, str(interpreted_plant)),
        printed(forked_importer, code, str(compiled_plant)),
    }
    assert len(runs) == 1
    assert len(runs.pop()) > 800
