"""Slave instances: which FMI functions are called, with what, and which are not called any more after a failure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cosim_master.diagnostics.errors import FmuError
from cosim_master.fmi.description.read import describe
from cosim_master.fmi.slaves.fmi2 import Batch, Instance2, Library
from cosim_master.fmi.slaves.libraries import Libraries


@pytest.fixture
def library(probes: Any) -> Any:
    with Libraries() as libraries:

        def load(**options: Any) -> Library:
            made: Library = libraries.load(describe(probes.fmu(**options)))
            return made

        yield load


def ready(library: Library, name: str = "one") -> Instance2:
    instance = library.instantiate(name)
    instance.setup_experiment(0.0, 2.0)
    instance.enter_initialization_mode()
    instance.exit_initialization_mode()
    return instance


def test_a_life(library: Any, probes: Any) -> None:
    made = library()
    one = made.instantiate("drone1.one")
    v = made.fmu.variables
    one.set([v["p"], v["when"]], [1.5, 9])
    one.set([v["mode"], v["n"], v["e"]], [0, 41, 5])
    one.setup_experiment(0.5, 2.0)
    one.enter_initialization_mode()
    one.set([v["u"]], [2])
    one.set([v["b"]], [True])
    one.set([v["s"]], ["grüß"])
    one.set([], [])
    assert one.get([v["y"], v["p"]]) == [3.5, 1.5]
    assert one.get([v["m"], v["f"]]) == [42, 5]
    assert one.get([v["c"]]) == [False]
    assert one.get([v["r"]]) == ["grüß!"]
    assert one.get([]) == []
    one.exit_initialization_mode()
    one.terminate()
    one.terminate()
    one.free()
    one.free()
    assert probes.calls == [
        f"drone1.one: {call}"
        for call in (
            "instantiate probe",
            "set p = 1.5",
            "set w = 9",
            "set x = 0",
            "set n = 41",
            "set e = 5",
            "setup 0.5 to 2",
            "enter",
            "set u = 2",
            "set b = true",
            'set s = "grüß"',
            "get y",
            "get p",
            "get m",
            "get f",
            "get c",
            "get r",
            "exit",
            "terminate",
            "free",
        )
    ]


def test_integers_are_those_of_c(library: Any) -> None:
    made = library()
    v = made.fmu.variables
    for number, wanted in ((-7, -7), (2**31 - 1, 2**31 - 1), (-(2**31), -(2**31)), (2**32 - 1, -1)):
        one = made.instantiate(f"of {number}")
        one.set(Batch([v["n"]]), [number - 1])
        one.setup_experiment(0.0, 2.0)
        one.enter_initialization_mode()
        assert one.get(Batch([v["m"]])) == [wanted]
        one.free()


@pytest.mark.parametrize(
    ("status", "word", "calls"),
    [
        (2, "fmi2Discard", ["one: terminate", "one: free"]),
        (3, "fmi2Error", ["one: free"]),
        (4, "fmi2Fatal", []),
        (5, "fmi2Pending", ["one: free"]),
        (17, "unknown status 17", ["one: terminate", "one: free"]),
    ],
)
def test_what_may_still_be_called_after_a_bad_status(
    library: Any, probes: Any, status: int, word: str, calls: list[str]
) -> None:
    """FMI 2.0.5, section 4.2.4: after an error only free, after a fatal one nothing at all."""
    one = ready(library())
    assert word in str(one.failure("fmi2DoStep", status))
    assert probes.calls[-1] == "one: exit"
    one.terminate()
    one.free()
    assert probes.calls == calls


def test_before_the_end_of_initialization_there_is_nothing_to_terminate(library: Any, probes: Any) -> None:
    one = library().instantiate("one")
    one.terminate()
    one.free()
    assert probes.calls == ["one: instantiate probe", "one: free"]


def test_a_failing_call_says_instance_function_status_time_and_log(library: Any) -> None:
    made = library()
    one = made.instantiate("drone1.one")
    one.set([made.fmu.variables["mode"]], [10])
    one.setup_experiment(0.25, 2.0)
    one.enter_initialization_mode()
    with pytest.raises(FmuError) as caught:
        one.exit_initialization_mode()
    assert str(caught.value) == (
        "drone1.one: fmi2ExitInitializationMode failed at t = 0.25 s: fmi2Error\n    no way out"
    )
    error = caught.value
    assert (error.instance, error.function, error.time) == ("drone1.one", "fmi2ExitInitializationMode", 0.25)
    assert error.log == ("no way out",)


def test_only_the_last_lines_of_a_log_are_kept(library: Any) -> None:
    one = ready(library())
    for i in range(100):
        one._callbacks.logger(None, b"one", 0, None, f"line {i}".encode())
    one._callbacks.logger(None, b"one", 0, b"events", None)
    one._callbacks.logger(None, b"one", 99, b"events", b"50 %% and \xff\n")
    assert len(one.lines) == 40
    assert [*one.lines][-2:] == ["line 99", "50 % and �"]


def test_a_refusal_with_reasons(library: Any) -> None:
    with pytest.raises(FmuError) as caught:
        library(guid="none").instantiate("one")
    assert str(caught.value) == ("one: fmi2Instantiate failed: it returned NULL\n    refused: 100% of\n    the reasons")


def test_a_refusal_without(library: Any) -> None:
    with pytest.raises(FmuError, match=r"it returned NULL; it logged nothing .is the GUID of its modelDescription.xml"):
        library(guid="mute").instantiate("one")


def test_an_fmu_that_has_one_handle_for_all_instances_is_refused(library: Any, probes: Any) -> None:
    made = library(guid="global")
    one = made.instantiate("one")
    with pytest.raises(FmuError, match=r"two: fmi2Instantiate failed: it returned the handle of one: .* one instance"):
        made.instantiate("two")
    del one.library.handles[one.handle]  # the probe's one and only is no heap memory: it must not be freed


def test_a_function_that_the_binary_does_not_have(library: Any, probes: Any) -> None:
    with pytest.raises(
        FmuError, match=r"Unit: fmi2SerializeFMUstate failed: the binary of .*probe.fmu does not have it"
    ):
        library().address("fmi2SerializeFMUstate")


def test_a_library_that_cannot_be_loaded(probes: Any) -> None:
    fmu = describe(probes.fmu(binary=b"no machine code"))
    with Libraries() as libraries, pytest.raises(FmuError, match=r"Unit: loading .*probe.fmu failed: .*"):
        libraries.load(fmu)


def test_the_resources_are_told_as_a_uri(library: Any, probes: Any, tmp_path: Path) -> None:
    made = library()
    made.resources = tmp_path / "a b%#ä"
    assert made.resources.as_uri().endswith("/a%20b%25%23%C3%A4")
    made.instantiate("one").free()
    assert probes.calls == ["one: instantiate probe", "one: free"]
