"""Parts of a run: what they must agree on, how one that fails ends the others, and values between them."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

from cosim_master.diagnostics.errors import FmuError, SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.partitions import starting
from cosim_master.execution.partitions.transport import LocalTransport, PartLost
from cosim_master.execution.simulate import simulate
from tests.master.parts import assigned, run_in_parts

pytestmark = pytest.mark.usefixtures("own_cache")


def table(out: Path) -> Any:
    return pq.read_table(out / "signals.parquet")


def two_probes(probes: Any, stop: float = 3.0, **values: float) -> Path:
    probes.fmu()
    path: Path = probes.ssd(probes.component("a", p=1.0) + probes.component("b", p=2.0, **values), stop=stop)
    return path


def oscillators(linears: Any, delay: float, stop: float) -> Path:
    """Two oscillators that drive each other with delays, and an integer that drives a real."""
    linears.fmu()
    parts = "".join(
        linears.component(name, step=0.5, x0=x, w2=0.3, gain=0.7) for name, x in (("a", 1.0), ("b", -2.0), ("c", 0.5))
    )
    master = f'><connection to="b.u" delay="{delay}" start="0.25"/>'
    master += f'<connection to="a.u" delay="{delay + 0.5}"/><connection to="c.u" delay="{delay}"/></master>'
    path: Path = linears.ssd(parts, "a/y b/u", "b/v a/u", "a/n c/u", master=master, stop=stop)
    return path


@pytest.mark.parametrize("mode", [2, 3, 5], ids=["discard", "error", "NaN"])
@pytest.mark.parametrize("first", [0, 1], ids=["in part 1", "in part 0"])
def test_an_instance_that_fails_ends_all_as_in_one_process(probes: Any, tmp_path: Path, mode: int, first: int) -> None:
    system = two_probes(probes, mode=mode, when=1.0)
    file = assigned(tmp_path / "parts.json", ["a", "b"], [first, 1 - first])
    whole = simulate(system, RunOptions(out=tmp_path / "whole"))
    result, errors = run_in_parts(system, RunOptions(out=tmp_path / "parts", assignment=file), 2)
    assert (result.outcome, errors) == ("failed", [])
    assert str(result.error).partition("\n")[0].partition(";")[0].startswith("b: fmi2")
    if mode != 2:  # a discarded step is repeated in one process, if the FMU can
        assert str(result.error) == str(whole.error)
    assert table(tmp_path / "parts").equals(table(tmp_path / "whole"))
    assert result.simulated_s == whole.simulated_s in (0.5, 1.0)


@pytest.mark.parametrize(("mode", "function"), [(10, "fmi2ExitInitializationMode"), (12, "fmi2Terminate")])
def test_an_instance_that_does_not_start_or_end(probes: Any, tmp_path: Path, mode: int, function: str) -> None:
    system = two_probes(probes, mode=mode, when=0.0)
    whole = simulate(system, RunOptions(out=tmp_path / "whole"))
    assert function in str(whole.error)
    file = assigned(tmp_path / "parts.json", ["a", "b"], [0, 1])
    result, errors = run_in_parts(system, RunOptions(out=tmp_path / "parts", assignment=file), 2)
    assert result.outcome == whole.outcome == "failed"
    assert str(result.error) == str(whole.error)
    assert all(type(error).__name__ in ("RunFailed", "Refused") for error in errors)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"versions": {"uav-cosim": "0.0.9"}}, "it has uav-cosim 0.0.9, part 0 has .*; install the same version"),
        ({"fmus": {"probe.fmu": "0123"}}, "its probe.fmu is another file than that of part 0; copy or build the same"),
        ({"cut": [1, 0]}, "it has another cut than part 0; give all parts the same options"),
        ({"fingerprint": {"seed": "5"}}, r"its run has other inputs than that of part 0 \(.*seed.*\)"),
    ],
)
def test_a_part_that_differs_is_refused_before_anything_runs(
    probes: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: dict[str, Any], text: str
) -> None:
    system = two_probes(probes)
    honest = starting.who

    def told(transport: Any, *arguments: Any) -> dict[str, Any]:
        own = honest(transport, *arguments)
        if transport.part == 1:
            for key, value in change.items():
                own[key] = {**own[key], **value} if isinstance(value, dict) else value
        return own

    monkeypatch.setattr("cosim_master.execution.simulate.who", told)
    with pytest.raises(SystemDescriptionError, match=rf"part 1 \(this process\): {text}"):
        run_in_parts(system, RunOptions(out=tmp_path / "out"), 2)
    assert probes.calls == []
    assert not (tmp_path / "out" / "manifest.json").exists()


def test_an_error_in_one_part_is_that_of_the_run(probes: Any, tmp_path: Path) -> None:
    system = two_probes(probes)
    wrong = RunOptions(overrides={"c.p": "1"})
    with pytest.raises(SystemDescriptionError, match=r"part 1: .*c\.p"):
        run_in_parts(system, RunOptions(), 2, others=[wrong])


def test_a_part_that_is_slow_changes_nothing(probes: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    system = two_probes(probes)
    simulate(system, RunOptions(out=tmp_path / "whole"))
    send = LocalTransport.send

    def slowly(self: LocalTransport, to: int, message: bytes) -> None:
        if self.part == 1:
            time.sleep(0.05)
        send(self, to, message)

    monkeypatch.setattr(LocalTransport, "send", slowly)
    result, errors = run_in_parts(system, RunOptions(out=tmp_path / "parts"), 2)
    assert (result.outcome, errors) == ("done", [])
    assert table(tmp_path / "parts").equals(table(tmp_path / "whole"))


def test_an_exception_of_a_part_ends_the_run(probes: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A bug in one part, simulated by an exchange that raises, must not let the others wait."""
    from cosim_master.execution.partitions.exchange import Exchange

    take, count = Exchange.take, [0]

    def breaks(self: Exchange, given: Any) -> None:
        if self._part == 1:
            count[0] += 1
            if count[0] > 3:
                raise KeyError("a bug")
        take(self, given)

    monkeypatch.setattr(Exchange, "take", breaks)
    probes.fmu()
    system = probes.ssd(probes.component("a", p=1.0) + probes.component("b", p=2.0), stop=100.0)
    result, errors = run_in_parts(system, RunOptions(out=tmp_path / "out"), 2)
    assert result.outcome == "failed"
    assert isinstance(result.error, PartLost)
    assert str(result.error) == ("part 1: it has failed: KeyError: 'a bug'; what was recorded until then is complete")
    assert [type(error) for error in errors] == [KeyError]
    times = table(tmp_path / "out")["time"].to_pylist()
    assert times == [0.5 * k for k in range(len(times))]
    assert times[-1] == result.simulated_s > 0.0


def test_a_profile_of_parts_is_refused(probes: Any) -> None:
    system = two_probes(probes)
    with pytest.raises(SystemDescriptionError, match="--profile: the profile of one part tells nothing of the others"):
        run_in_parts(system, RunOptions(profile=True), 2)
    assert probes.calls == []


# ---- checkpoints ----------------------------------------------------------------------------------------------------


def test_parts_whose_instances_cannot_save_their_states_have_no_checkpoints(probes: Any, tmp_path: Path) -> None:
    system = two_probes(probes)
    options = RunOptions(out=tmp_path / "out", checkpoint_every=1.0)
    with pytest.raises(SystemDescriptionError, match="canGetAndSetFMUstate of a is false"):
        run_in_parts(system, options, 2)


def test_a_part_that_fails_to_save_ends_the_run(linears: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from cosim_master.execution.partitions import part
    from cosim_master.execution.partitions.checkpoints import part_state

    def fails(state: Any, cut: Any, number: int) -> Any:
        if number == 1:
            raise FmuError("b", "fmi2SerializeFMUstate", "fails", state.time)
        return part_state(state, cut, number)

    monkeypatch.setattr(part, "part_state", fails)
    system = oscillators(linears, 1.0, stop=4.0)
    file = assigned(tmp_path / "parts.json", ["a", "b", "c"], [0, 1, 0])
    options = RunOptions(out=tmp_path / "out", assignment=file, checkpoint_every=1.0)
    result, errors = run_in_parts(system, options, 2)
    assert (result.outcome, errors) == ("failed", [])
    assert str(result.error).startswith("b: fmi2SerializeFMUstate")
    assert table(tmp_path / "out")["time"].to_pylist() == [0.0, 0.5, 1.0]
    assert [*(tmp_path / "out" / "checkpoints").glob("*/checkpoint.json")] == []


def test_a_checkpoint_that_one_part_cannot_read_ends_all(linears: Any, tmp_path: Path) -> None:
    system = oscillators(linears, 1.0, stop=4.0)
    simulate(system, RunOptions(out=tmp_path / "whole", checkpoint_every=2.0))
    options = RunOptions(out=tmp_path / "out", origin=f"{tmp_path}/whole@2")
    with pytest.raises(SystemDescriptionError, match=r"part 1: .*has no checkpoint at 3 s; there are: 2"):
        run_in_parts(system, options, 2, others=[RunOptions(origin=f"{tmp_path}/whole@3")])


# ---- values between parts ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("delay", [0.5, 1.0, 1.5, 3.0])
def test_delayed_values_cross_the_cut(linears: Any, tmp_path: Path, delay: float) -> None:
    system = oscillators(linears, delay, stop=40.0)
    simulate(system, RunOptions(out=tmp_path / "whole"))
    for places in ([0, 1, 0], [0, 1, 2], [1, 1, 0]):
        file = assigned(tmp_path / "parts.json", ["a", "b", "c"], places)
        options = RunOptions(out=tmp_path / "parts", assignment=file)
        result, errors = run_in_parts(system, options, max(places) + 1)
        assert (result.outcome, errors) == ("done", [])
        assert table(tmp_path / "parts").equals(table(tmp_path / "whole"))


@pytest.mark.parametrize("delay", [0.5, 1.0, 3.0])
def test_values_under_way_are_part_of_a_checkpoint(linears: Any, tmp_path: Path, delay: float) -> None:
    system = oscillators(linears, delay, stop=20.0)
    simulate(system, RunOptions(out=tmp_path / "whole", checkpoint_every=5.0))

    def in_parts(name: str, places: list[int], **options: Any) -> None:
        file = assigned(tmp_path / "parts.json", ["a", "b", "c"], places)
        result, errors = run_in_parts(
            system, RunOptions(out=tmp_path / name, assignment=file, **options), max(places) + 1
        )
        assert (result.outcome, errors) == ("done", [])
        assert table(tmp_path / name).equals(table(tmp_path / "whole"))

    in_parts("parts", [0, 1, 2], checkpoint_every=2.5)
    in_parts("other parts", [1, 0, 1], origin=f"{tmp_path}/parts@7.5")
    in_parts("parts of one", [0, 1, 0], origin=f"{tmp_path}/whole@10")
    simulate(system, RunOptions(out=tmp_path / "one", origin=f"{tmp_path}/parts@12.5"))
    assert table(tmp_path / "one").equals(table(tmp_path / "whole"))
