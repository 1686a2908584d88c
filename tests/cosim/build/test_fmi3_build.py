"""FMI 3.0 FMUs: their description, their numbers in FMPy, saved states."""

from __future__ import annotations

import importlib.util
import zipfile
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave, printLogMessage
from lxml import etree

from cosim import Input, Model, Output
from cosim.build import CannotCompile, build
from cosim.build.description3 import PACKET_MIME_TYPE, exported
from cosim.vehicle import MOTION_INPUTS
from tests.cosim.build.validation import faults
from tests.cosim.shipped import models_with_kernels
from tests.models.shipped_kernels import kernels

MODELS = models_with_kernels()
every_model = pytest.mark.parametrize("name", sorted(MODELS))
TYPES = {"Real": "Float64", "Integer": "Int32", "Boolean": "Boolean", "Enumeration": "Int64", "Packets": "Binary"}


def _load(file: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(file, (Path(__file__).parents[1] / f"{file}.py"))
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


driving = _load("driving")


def instance(file: Path, folder: Path, *, initialise: bool = True, **options: Any) -> FMU3Slave:
    description = fmpy.read_model_description(str(file))
    fmu = FMU3Slave(
        guid=description.guid,
        unzipDirectory=fmpy.extract(str(file), str(folder)),
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="one",
    )
    fmu.instantiate(logMessage=printLogMessage, **options)
    if initialise:
        fmu.enterInitializationMode(startTime=0.0)
        fmu.exitInitializationMode()
    return fmu


def read(model: type[Model], fmu: FMU3Slave) -> list[Any]:
    """All values of an instance, one after another as an FMI 2 FMU has them."""
    values: list[Any] = []
    for reference, v in enumerate(exported(model)):
        count = v.shape[0] if v.shape else 1
        got = list(getattr(fmu, f"get{TYPES[v.kind]}")([reference], nValues=count))
        values += [driving.base64.b64encode(x) for x in got] if v.kind == "Packets" else got
    return values


def set_inputs(model: type[Model], fmu: FMU3Slave, step: int) -> None:
    """The inputs that `driving` sets in FMI 2 FMUs, whole arrays at once."""
    news: dict[str, list[Any]] = {}
    for reference, one in driving.inputs(model):
        news.setdefault(one.variable.name, []).append(driving.value(one, reference, step))
    for reference, v in enumerate(exported(model)):
        if v.name in news:
            getattr(fmu, f"set{TYPES[v.kind]}")([reference], news[v.name])


# -- the description ------------------------------------------------------------------------------------------------


@every_model
def test_fmpy_finds_nothing_wrong(name: str, fmi3_fmus: Path) -> None:
    assert faults(fmi3_fmus / f"{name}.fmi3.fmu") == []


def test_description_of_the_plant(plant3: Path) -> None:
    assert faults(plant3) == []
    assert plant3.name == "Plant.fmi3.fmu"
    described = fmpy.read_model_description(str(plant3))
    assert described.fmiVersion == "3.0"
    assert described.coSimulation.canGetAndSetFMUstate
    assert described.coSimulation.canSerializeFMUstate
    assert not described.coSimulation.hasEventMode
    found = {v.name: v for v in described.modelVariables}
    assert [v.valueReference for v in described.modelVariables] == list(range(len(found)))
    w = found["w"]
    assert (w.type, w.start, [d.start for d in w.dimensions]) == ("Float64", "1.0 2.0 3.0", [3])
    assert (found["names"].type, found["names"].start) == ("Boolean", "true false")
    with zipfile.ZipFile(plant3) as archive:
        root = etree.fromstring(archive.read("modelDescription.xml"))
    (packets,) = root.findall("ModelVariables/Binary[@name='rx']")
    assert (packets.get("mimeType"), packets.get("maxSize"), packets.get("clocks")) == (PACKET_MIME_TYPE, "10", None)
    assert (found["gear"].type, found["gear"].start, found["gear"].declaredType.name) == ("Enumeration", "2", "Gear")
    assert (found["gain"].unit, found["gain"].min, found["gain"].max) == ("1/s", "0.0", "10.0")
    assert (found["time"].causality, found["time"].type) == ("independent", "Float64")
    outputs = {u.variable.name: [d.name for d in u.dependencies] for u in described.outputs}
    assert outputs == {"y": ["u"], "z": ["w"], "total": ["count"], "ready": ["enable"], "engaged": ["gear"], "tx": []}


def test_terminals_of_vehicle_and_autopilot_plug_into_each_other(fmi3_fmus: Path) -> None:
    members: dict[str, dict[str, list[str]]] = {}
    for name in ("Quadrotor", "Hexarotor", "Autopilot", "LineAgent"):
        with zipfile.ZipFile(fmi3_fmus / f"{name}.fmi3.fmu") as archive:
            root = etree.fromstring(archive.read("terminalsAndIcons/terminalsAndIcons.xml"))
        members[name] = {
            t.get("name", ""): [m.get("memberName", "") for m in t] for t in root.iterfind("Terminals/Terminal")
        }
    assert members["Quadrotor"]["vehicle"] == ["motor", *(v.name for v in MOTION_INPUTS)]
    assert members["Quadrotor"] == members["Hexarotor"]
    assert members["Autopilot"]["vehicle"] == members["Quadrotor"]["vehicle"]
    assert members["Autopilot"]["mavlink"] == members["LineAgent"]["mavlink"] == ["mavlink_rx", "mavlink_tx"]
    assert [members["Autopilot"][line] for line in ("telemetry", "serial")] == [
        ["telemetry_rx", "telemetry_tx"],
        ["serial_rx", "serial_tx"],
    ]


# -- the numbers ----------------------------------------------------------------------------------------------------


@every_model
def test_the_same_bits_as_the_record(name: str, fmi3_fmus: Path, tmp_path: Path) -> None:
    model, steps = MODELS[name], 120
    rows = driving.drive_record(model, steps, kernels(model))
    fmu = instance(fmi3_fmus / f"{name}.fmi3.fmu", tmp_path)
    for step in range(steps + 1):
        assert read(model, fmu) == driving.read_record(model, rows[step]), f"after step {step}"
        set_inputs(model, fmu, step)
        fmu.doStep(step * model.step_size, model.step_size)
    fmu.terminate()
    fmu.freeInstance()
    assert (rows[0] != rows[-1]).any()


def test_fmpy_simulates_the_plant(plant3: Path) -> None:
    """x' = gain u, by Euler: 10 + 2 * 0.5 t; y = x + gain u."""
    result = fmpy.simulate_fmu(str(plant3), stop_time=1.0, output_interval=0.125, output=["x", "y", "z"])
    assert result["x"] == pytest.approx(10.0 + result["time"])
    assert result["y"] == pytest.approx(11.0 + result["time"])
    assert np.array_equal(result["z"], np.full((9, 2), 3.0))


def test_a_saved_state_goes_on_in_another_instance(
    plant3: Path, compiled_plant: Path, samples: SimpleNamespace, tmp_path: Path
) -> None:
    model = samples.Plant
    one, other = instance(plant3, tmp_path / "one"), instance(plant3, tmp_path / "other")
    for step in range(3):
        set_inputs(model, one, step)
        one.doStep(step * 0.125, 0.125)
    state = one.getFMUState()
    data = one.serializeFMUState(state)
    other.setFMUState(other.deserializeFMUState(data))
    for fmu in (one, other):
        set_inputs(model, fmu, 3)
        fmu.doStep(0.375, 0.125)
    assert read(model, one) == read(model, other)
    one.freeFMUState(state)


# -- what is refused ------------------------------------------------------------------------------------------------


def test_event_mode_is_refused_as_declared(plant3: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(Exception, match="Failed to instantiate"):
        instance(plant3, tmp_path, eventModeUsed=True)
    assert "hasEventMode is false" in capfd.readouterr().out


def test_too_few_values_for_an_array(plant3: Path, tmp_path: Path) -> None:
    fmu = instance(plant3, tmp_path)
    with pytest.raises(FMICallException):
        fmu.setFloat64([2], [1.0, 2.0])
    assert list(fmu.getFloat64([2], nValues=3)) == [1.0, 2.0, 3.0]


def test_models_without_kernels_are_fmi_2_only(samples: SimpleNamespace, tmp_path: Path) -> None:
    with pytest.raises(CannotCompile, match="Text has no kernels"):
        build(samples.Text, tmp_path, fmi=3)
    with pytest.raises(CannotCompile, match="creates an array"):
        build(samples.Allocates, tmp_path, fmi=3)
    with pytest.raises(ValueError, match="interpreted FMUs are FMI 2 only"):
        build(samples.Plant, tmp_path, fmi=3, interpreted=True)
    with pytest.raises(ValueError, match="FMI 1: not supported; valid: 2 and 3"):
        build(samples.Plant, tmp_path, fmi=1)
    assert list(tmp_path.iterdir()) == []


class Clockwork(Model):
    """A variable with the name of the independent one."""

    step_size = 0.1
    variables = (Input("time"), Output("y"))


def test_no_variable_is_called_time() -> None:
    with pytest.raises(ValueError, match=r"Clockwork\.time: in FMI 3 this is the independent variable"):
        exported(Clockwork)
