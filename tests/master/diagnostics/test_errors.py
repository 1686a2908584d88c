"""What errors print."""

from __future__ import annotations

import pytest

from cosim_master.diagnostics.errors import CosimError, FmuError, Problem, SystemDescriptionError, Where


def test_a_description_error_prints_every_problem_with_its_place() -> None:
    problems = [Problem(Where("a.ssd", 3), "one"), Problem(Where("b.fmu"), "two")]
    error = SystemDescriptionError(problems)
    assert str(error) == "a.ssd:3: one\nb.fmu: two"
    assert error.problems == tuple(problems) and isinstance(error, CosimError)


def test_an_error_without_a_problem_is_a_mistake() -> None:
    with pytest.raises(ValueError, match="at least one problem"):
        SystemDescriptionError([])


def test_an_fmu_error_says_who_what_when_and_its_last_words() -> None:
    error = FmuError("drone1.vehicle", "fmi2DoStep", "fmi2Error", 1.5, ["no ground", "stopping"])
    assert str(error) == "drone1.vehicle: fmi2DoStep failed at t = 1.5 s: fmi2Error\n    no ground\n    stopping"
    assert (error.instance, error.function, error.status, error.time) == (
        "drone1.vehicle",
        "fmi2DoStep",
        "fmi2Error",
        1.5,
    )
    assert str(FmuError("a", "fmi2Instantiate", "no instance")) == "a: fmi2Instantiate failed: no instance"


def test_what_an_fmu_logs_again_and_again_is_shown_once() -> None:
    error = FmuError("a", "fmi2SetReal", "fmi2Error", 0.0, ["out of range", "no", "no", "no", "out of range"])
    assert str(error).splitlines()[1:] == ["    out of range", "    no (3 times)", "    out of range"]
    assert error.log == ("out of range", "no", "no", "no", "out of range")


def test_the_words_of_pythonfmus_wrapper_are_left_out_where_there_are_others() -> None:
    wrapper = ["Fatal py exception encountered: [doStep] PyObject_CallMethod", "unknown error"]
    assert str(FmuError("a", "fmi2DoStep", "fmi2Fatal", 0.0, ["no battery", *wrapper])).splitlines()[1:] == [
        "    no battery"
    ]
    assert str(FmuError("a", "fmi2DoStep", "fmi2Fatal", 0.0, wrapper)).splitlines()[1:] == [f"    {w}" for w in wrapper]
