"""Studies are data: factors, designs, and what is wrong with them is said."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim_master.campaigns.metrics.metric import Metric
from cosim_master.campaigns.running.options import commands
from cosim_master.campaigns.running.prefix import groups
from cosim_master.campaigns.study.designs import Design, points
from cosim_master.campaigns.study.factors import Factor
from cosim_master.campaigns.study.study import Study
from cosim_master.diagnostics.errors import SystemDescriptionError


def factors(*texts: str) -> tuple[Factor, ...]:
    return tuple(map(Factor.parsed, texts))


def test_a_factor_is_a_list_a_range_or_an_interval() -> None:
    assert Factor.parsed("network.loss=0,0.1").values == ("0", "0.1")
    assert Factor.parsed("a.b=0.1:0.6:6").values == ("0.1", "0.2", "0.3", "0.4", "0.5", "0.6")
    assert Factor.parsed("network.topology=line, nearest").values == ("line", "nearest")
    assert not Factor.parsed("network.topology=line,nearest").numeric
    interval = Factor.parsed("a.b=-1:3")
    assert (interval.continuous, interval.numeric, interval.at(0.25)) == (True, True, "0")
    later = Factor.parsed("drone3.vehicle.wind[2]@30=0,5")
    assert (later.name, later.time, later.label) == ("drone3.vehicle.wind[2]", 30.0, "drone3.vehicle.wind[2]@30")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a.b", "write NAME=VALUE,VALUE"),
        ("a.b=", "write NAME=VALUE,VALUE"),
        ("=1", "has no name"),
        ("a.b=1,2,1", "has the value 1 twice"),
        ("a.b=0.1,0.10", "has the value 0.10 twice"),
        ("a.b=line,nearest,line", "has the value line twice"),
        ("a.b=3:1", "give a smaller and a greater number"),
        ("a.b=1:2:1", "the number of values is 2 to 1000000"),
        ("a.b=1:x:3", "write FROM:TO:NUMBER"),
        ("a.b=1:inf:3", "give finite numbers"),
        ("a.b@0=1,2", "give a positive time"),
    ],
)
def test_a_wrong_factor_is_refused(text: str, says: str) -> None:
    with pytest.raises(SystemDescriptionError, match=says):
        Factor.parsed(text)


def test_a_grid_has_every_combination_and_each_seed() -> None:
    study = Study(system="line5", factors=factors("a.b=1,2", "c.d=x,y,z"), seeds=(4, 9))
    runs = study.runs()
    assert [run.run for run in runs] == [*range(12)]
    assert {(run.values["a.b"], run.values["c.d"], run.seed) for run in runs} == {
        (a, c, seed) for a in "12" for c in "xyz" for seed in (4, 9)
    }
    assert [run.point for run in runs] == [n // 2 for n in range(12)]


def test_designs_that_sample_are_those_of_scipy() -> None:
    from scipy.stats import qmc  # takes a second: only those who run this test wait for it

    varied = factors("a.b=10:20", "c.d=x,y")
    sequence = points(Design("sobol", 8), varied)
    drawn = qmc.Sobol(2, rng=1).random_base2(3)
    np.testing.assert_allclose([float(one["a.b"]) for one in sequence], 10 + 10 * drawn[:, 0], rtol=1e-11)
    assert [one["c.d"] for one in sequence] == ["xy"[int(2 * share)] for share in drawn[:, 1]]
    cube = [float(one["a.b"]) for one in points(Design("lhs", 50), varied)]
    assert sorted(int(5 * (value - 10)) for value in cube) == [*range(50)]  # one in each of 50 equal parts
    assert points(Design("lhs", 50), varied) == points(Design("lhs", 50), varied)
    assert points(Design("lhs", 50, seed=2), varied) != points(Design("lhs", 50), varied)


def test_designs_for_sensitivity_have_the_points_that_their_method_needs() -> None:
    varied = factors("a.b=0:1", "c.d=0:3", "e.f=5:6")
    trajectories = np.array([[float(v) for v in one.values()] for one in points(Design("morris", 7), varied)])
    assert trajectories.shape == (7 * 4, 3)
    changes = (np.diff(trajectories.reshape(7, 4, 3), axis=1) != 0).sum(axis=2)
    assert (changes == 1).all()  # one factor at a time
    assert len(points(Design("indices", 16), varied)) == 16 * 5


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("gird", "there is no such design"),
        ("grid:5", "leave out the number"),
        ("lhs", "give a number of at least 2"),
        ("lhs:x", "write lhs:NUMBER"),
        ("lhs:-3", "write lhs:NUMBER"),
    ],
)
def test_a_wrong_design_is_refused(text: str, says: str) -> None:
    with pytest.raises(SystemDescriptionError, match=says):
        Design.parsed(text)


def test_designs_that_do_not_fit_the_factors_are_refused() -> None:
    with pytest.raises(SystemDescriptionError, match="a grid needs a number of values"):
        points(Design(), factors("a.b=1:2"))
    with pytest.raises(SystemDescriptionError, match="the number is a power of two; try 16"):
        points(Design("indices", 9), factors("a.b=1:2"))
    with pytest.raises(SystemDescriptionError, match="there is nothing to vary"):
        points(Design("lhs", 9), ())
    with pytest.raises(SystemDescriptionError, match="more than 10000000 points"):
        points(Design(), factors("a.b=1:2:10000", "c.d=1:2:10000"))


def test_a_study_is_the_same_after_json() -> None:
    study = Study(
        system="line5", factors=factors("a.b=1,2", "c.d@3=0:1"), design=Design("lhs", 4), seeds=(1, 2),
        metrics=(Metric.parsed("m=2 * packets_lost"),), keep=("*.position*",), overrides={"e.f": "3"},
        at=((2.0, "g.h", "1"),), until=5.0,
    )  # fmt: skip
    again = Study.of_json(json.loads(json.dumps(study.as_json())))
    assert again.as_json() == study.as_json()
    assert again.digest() == study.digest()
    assert again.runs() == study.runs()
    with pytest.raises(SystemDescriptionError, match="is not one"):
        Study.of_json({"factors": []})


def test_columns_have_different_names() -> None:
    with pytest.raises(SystemDescriptionError, match="has a column of this name already"):
        Study(system="line5", metrics=(Metric.parsed("seed=packets_lost"),))
    with pytest.raises(SystemDescriptionError, match=r'--vary "a\.b": it is varied twice; give all its values in one'):
        Study(system="line5", factors=factors("a.b=1,2", "a.b=3,4"))
    text = r'--vary "seed": the dataset has a column .* as COMPONENT\.seed; seeds .* are varied by --seeds$'
    with pytest.raises(SystemDescriptionError, match=text):
        Study(system="line5", factors=factors("seed=1,2"))
    with pytest.raises(SystemDescriptionError, match=r"column of this name; give .* as COMPONENT\.point$"):
        Study(system="line5", factors=factors("point=1,2"))
    with pytest.raises(SystemDescriptionError, match=r'--vary "d\*\.b": this pattern matches d3\.b, too, which would'):
        Study(system="line5", factors=factors("d3.b=1,2", "d*.b=3,4"))
    with pytest.raises(SystemDescriptionError, match=r'--vary "d\*\.b": this pattern matches d3\.b, too, which would'):
        Study(system="line5", factors=factors("d*.b=3,4"), overrides={"d3.b": "1"})
    with pytest.raises(SystemDescriptionError, match=r'--vary "network\.loss": it is set by --set, too, which would'):
        Study(system="line5", factors=factors("network.loss=0,0.1"), overrides={"network.loss": "0.3"})
    Study(system="line5", factors=factors("d3.b=1,2", "d*.b@3=3,4"), overrides={"d*.b": "1"})  # each has an effect
    with pytest.raises(SystemDescriptionError, match="a seed is given twice"):
        Study(system="line5", seeds=(1, 1))
    with pytest.raises(SystemDescriptionError, match="seeds are varied by --seeds"):
        Study(system="line5", factors=factors("network.seed=1,2"))


def test_only_what_acts_later_leaves_a_beginning_to_share() -> None:
    start = Study(system="line5", factors=factors("a.b=1,2"), seeds=(1, 2))
    assert [shared for shared, _ in groups(start, start.runs())] == [False] * 4
    later = Study(system="line5", factors=factors("a.b=1,2", "c.d@30=0,1,2", "e.f@40=0,1"), seeds=(1, 2))
    found = groups(later, later.runs())
    assert [(shared, len(group)) for shared, group in found] == [(True, 6)] * 4
    assert all(len({(run.seed, run.values["a.b"]) for run in group}) == 1 for _, group in found)
    alone = Study(system="line5", factors=factors("c.d@30=5"))
    assert [shared for shared, _ in groups(alone, alone.runs())] == [False]
    setting = Study(system="line5", factors=factors("network.loss@30=0.5"))
    assert [shared for shared, _ in groups(setting, setting.runs())] == [True]  # it changes at a checkpoint only
    twice = Study(system="line5", factors=factors("network.loss@30=0,1", "network.jitter@40=0,1"))
    with pytest.raises(SystemDescriptionError, match="settings of the radio change at one time only"):
        groups(twice, twice.runs())
    recording = Study(system="line5", factors=factors("recording.interval@30=1,2"))
    with pytest.raises(SystemDescriptionError, match="a recording does not change during a run"):
        groups(recording, recording.runs())


def test_a_command_repeats_a_run() -> None:
    study = Study(system="line5", factors=factors("drone*.a.b=1,2", "c.d@30=7"), seeds=(5,), until=60.0)
    assert commands(study, study.runs()[1], 0.0) == [
        "uav-cosim run line5 --set 'drone*.a.b=2' --seed 5 --until 60 --at 30 c.d=7 -o run-1"
    ]
    branched = Study(system="line5", factors=factors("network.loss@30=0.5"), until=60.0)
    assert commands(branched, branched.runs()[0], 0.0) == [
        "uav-cosim run line5 --until 60 --checkpoint-every 30 -o run-0-begin",
        "uav-cosim run line5 --from run-0-begin@30 --set network.loss=0.5 -o run-0",
    ]


def test_what_python_has_at_hand_is_taken_for_a_study() -> None:
    given: dict[str, Any] = {
        "system": Path("line5"),
        "factors": [
            Factor("a.b", values=(0.0, 0.1)),  # type: ignore[arg-type]
            Factor("c.d", values=np.linspace(0.0, 0.1, 2)),  # type: ignore[arg-type]
            Factor("e.f", values=[1, True, "x"]),  # type: ignore[arg-type]
            "g.h=1,2",
        ],
        "seeds": np.arange(2),
        "metrics": ("error_to_law", Metric.parsed("packets_lost")),
        "keep": ["a.*"],
        "overrides": {"network.loss": np.float64(0.1)},
        "at": [(np.int64(1), "a.x", np.float32(0.5))],
        "until": np.float32(30.0),
    }
    study = Study(**given)
    assert [one.values for one in study.factors] == [("0.0", "0.1"), ("0.0", "0.1"), ("1", "true", "x"), ("1", "2")]
    wanted = Study(
        system="line5",
        factors=study.factors,
        seeds=(0, 1),
        metrics=(Metric.parsed("error_to_law"), Metric.parsed("packets_lost")),
        keep=("a.*",),
        overrides={"network.loss": "0.1"},
        at=((1.0, "a.x", "0.5"),),
        until=30.0,
    )
    assert study == wanted
    assert json.loads(json.dumps(study.as_json())) == wanted.as_json()
    assert Factor("a.b", low=np.float32(0.5), high=np.int64(2)) == Factor("a.b", low=0.5, high=2)  # type: ignore[arg-type]
    assert json.dumps(Study(system="line5", design=Design("lhs", np.int64(4)), factors=factors("a.b=0:1")).as_json())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"system": 5}, "system: is 5, not a path; try system='line5'"),
        ({"seeds": 2}, "seeds: is 2, not a sequence; try seeds=range(1, 11)"),
        ({"seeds": (1.5,)}, "seeds: is 1.5; give a whole number from 0 to 9007199254740992"),
        ({"metrics": "error_to_law"}, "metrics: is 'error_to_law', not a sequence; try metrics=('error_to_law',)"),
        (
            {"metrics": (3,)},
            "metrics: contains 3, not a Metric; try Metric.parsed('error_to_law'), or this text itself",
        ),
        ({"keep": "a.*"}, "keep: is 'a.*', not a sequence; try keep=(\"*.vehicle.*\",)"),
        ({"until": "30"}, "until: is '30'; give a number"),
    ],
)
def test_wrong_kinds_are_refused_by_name(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(SystemDescriptionError) as caught:
        Study(**{"system": "line5", **wrong})
    assert str(caught.value) == message


def test_wrong_kinds_in_factors_and_designs_are_refused() -> None:
    given: dict[str, Any] = {"values": 0.1}
    with pytest.raises(SystemDescriptionError, match=r"factor a.b: values: is 0.1, not a sequence; try values="):
        Factor("a.b", **given)
    given = {"low": "0.1", "high": 1.0}
    with pytest.raises(SystemDescriptionError, match=r"factor a.b: low: is '0.1'; give a number"):
        Factor("a.b", **given)
    given = {"size": 2.0}
    with pytest.raises(SystemDescriptionError, match=r"size: is 2.0; give a whole number of 0 or more"):
        Design("lhs", **given)
