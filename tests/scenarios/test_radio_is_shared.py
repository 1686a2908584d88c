"""A swarm on a radio with all its effects: every run of it is the same, and too many drones fill the medium."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import pytest

from cosim_master import RunOptions, RunResult, simulate
from cosim_master.system.authoring.swarm.new import new_system
from tests.scenarios.flights import copy_of
from tests.scenarios.test_radio_is_bad import with_radio

RECORDED = ("signals.parquet", "packets.parquet", "packets.tlog", "packets/drone1.tlog", "packets/drone3.tlog")
EVERYTHING = (
    'loss="0.05" latency="0.01" jitter="0.1" burstStart="0.05" burstEnd="0.3" sensitivity="-55" exponent="2.5" '
    'shadowing="4" rayleigh="true" bitErrors="0.0002" duplicates="0.1" queue="0.3"'
)
MEDIA = {
    "shared": 'medium="shared" rate="9600"',
    "aloha": 'medium="aloha" slot="0.02" window="6"',
    "csma": 'medium="csma" rate="9600" backoff="0.1" sensing="0.001"',
}
LOST = {"shared": "queue", "aloha": "collision", "csma": "collision"}
"""The cause of loss that each medium adds."""
SCHEDULE = '<partition nodes="drone1 drone2" start="5" stop="7"/><jamming east="50" radius="5" start="8" stop="9"/>'
CAUSES = ("channel", "burst", "signal", "errors", "partition", "jammed")


@pytest.fixture(scope="module", params=MEDIA)
def everything(
    request: pytest.FixtureRequest, fmus: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, str]:
    """A system with all effects and a medium, and the cause of loss that this adds."""
    attributes = f"{EVERYTHING} {MEDIA[request.param]}"
    folder = tmp_path_factory.mktemp(request.param)
    return copy_of("line5", folder, fmus, lambda text: with_radio(text, attributes, SCHEDULE)), LOST[request.param]


def test_with_all_effects_a_run_is_the_same_whatever_the_threads_and_when_it_is_resumed(
    everything: tuple[Path, str], tmp_path: Path
) -> None:
    system, cause_of_medium = everything

    def ran(name: str, **options: object) -> RunResult:
        result = simulate(system, RunOptions(out=tmp_path / name, **options))  # type: ignore[arg-type]
        assert result.outcome == "done"
        return result

    options = {"until": 10.0, "checkpoint_every": 6.0, "record": ["*.position*"]}
    whole = ran("whole", threads=1, **options)
    ran("threads", threads=2, **options)
    ran("rest", origin=f"{tmp_path / 'whole'}@6", **options)
    for name in RECORDED:
        expected = (tmp_path / "whole" / name).read_bytes()
        assert (tmp_path / "threads" / name).read_bytes() == expected, name
        assert (tmp_path / "rest" / name).read_bytes() == expected, name
    counts = whole.packets
    assert all(counts[f"lost: {cause}"] > 0 for cause in CAUSES), counts
    assert counts["duplicates"] > 0
    assert counts[f"lost: {cause_of_medium}"] > 0, counts
    assert counts["sent"] == counts["delivered"] + counts["lost"] + counts["in flight"]
    assert counts["lost"] == sum(n for cause, n in counts.items() if cause.startswith("lost: "))
    links = [json.loads((tmp_path / name / "manifest.json").read_text())["links"] for name in ("whole", "rest")]
    assert links[0] == links[1]
    of_links: Counter[str] = Counter()
    for one in links[0]["worst"]:
        of_links.update({"sent": one["sent"], "lost": one["lost"], "arrived or in flight": one["delivered"]})
        of_links.update({f"lost: {cause}": n for cause, n in one["causes"].items()})
    assert whole.verdict is not None
    told = {one.kind: one for one in whole.verdict.findings if one.kind in ("overloaded radio", "packets lost")}
    assert ("overloaded radio" in told) == (
        cause_of_medium == "queue" or counts["lost: collision"] > 0.2 * counts["sent"]
    )
    for one in told.values():
        (of_link,) = [link for link in links[0]["worst"] if (link["from"], link["to"]) == one.who]
        assert {name.removeprefix("lost: "): n for name, n in one.numbers.items() if ": " in name} == of_link["causes"]
        assert (one.numbers["sent"], one.numbers["lost"]) == (of_link["sent"], of_link["lost"])
    addressed = {name: n for name, n in counts.items() if name.startswith("lost: ") and n and name != "lost: no route"}
    assert {name: n for name, n in of_links.items() if name.startswith("lost: ")} == addressed
    assert of_links["sent"] == counts["sent"] - counts["lost: no route"]
    assert of_links["arrived or in flight"] == counts["delivered"] + counts["in flight"]


@pytest.mark.slow
def test_57600_baud_are_enough_for_ten_drones_and_not_for_fifty(fmus: Path, tmp_path: Path) -> None:
    """Each sends about 260 byte/s, so that 22 fill a medium of 5760."""
    lost = {}
    for drones in (10, 50):
        system = new_system("line", drones, tmp_path / str(drones), fmus=fmus)
        medium = {"network.medium": "shared", "network.rate": "57600"}
        result = simulate(system, RunOptions(overrides=medium, until=16.0))
        lost[drones] = result.packets.get("lost: queue", 0) / result.packets["sent"]
        assert result.verdict is not None
        assert ("overloaded radio" in [one.kind for one in result.verdict.findings]) == (drones == 50)
    assert lost[10] == 0.0
    assert lost[50] > 0.4
