"""A user's own effect of the radio: its closed form, its inputs, its random numbers, and files that are refused."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cosim.channel import PACKET, chance, normal
from cosim.kernel import table
from cosim_master.diagnostics.errors import Problem, SystemDescriptionError
from cosim_master.network.radio.build import packet_counts
from cosim_master.network.radio.link.own import address_of
from cosim_master.network.radio.tables import BY_RADIO, LOST_OWN
from cosim_master.system import shipped
from cosim_master.system.settings.radio import own_channel
from cosim_master.system.settings.radio.own_channel import OwnChannel, read_own_channel
from tests.master.network.test_radio import SECOND, Air, each_alone, fates, packet, spread

TEMPLATE = shipped.templates()["channel"]
HEAD = "import math\nfrom cosim.channel import LOST, Packet, chance, normal\n"
FIVE_SIGMA = 5.0


def own(path: Path, text: str) -> OwnChannel:
    path.write_text(text, encoding="utf-8")
    problems: list[Problem] = []
    found = read_own_channel(path, path.name, problems)
    assert found is not None, problems
    return found


@pytest.fixture
def air(tmp_path: Path) -> Any:
    """Makes nodes whose radio has the effect with this body of `channel(packet)`."""

    def make(body: str, n: int = 2, **network: Any) -> Air:
        code = f"{HEAD}def channel(packet: Packet) -> float:\n    {body}\n"
        return each_alone(n, own=own(tmp_path / "x.py", code), **network)

    return make


# ---- closed forms -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("distance", [30.0, 60.0, 90.0])
def test_the_starting_point_repeats_packets_as_its_closed_form_says(distance: float, tmp_path: Path) -> None:
    """Attempts are independent with p = exp(-(d / 60 m)^2): (1 - p)^k p arrive k pauses late, (1 - p)^3 are lost."""
    air, count = each_alone(2, own=own(tmp_path / "x.py", TEMPLATE.read_text(encoding="utf-8")), seed=7), 10_000
    air.at("n1", 0.6 * distance, 0.0, -0.8 * distance)
    spread(air, "n0", count)
    p = math.exp(-((distance / 60.0) ** 2))
    delays = Counter(
        round((int(e["arrival"]) - int(e["sent"])) / 1e9, 9) if e["outcome"] == BY_RADIO else None for e in air.events
    )
    expected = {0.0: p, 0.05: (1 - p) * p, 0.1: (1 - p) ** 2 * p, None: (1 - p) ** 3}
    assert delays.keys() <= expected.keys()
    for delay, share in expected.items():
        sigma = math.sqrt(share * (1.0 - share) / count)
        assert delays[delay] / count == pytest.approx(share, abs=FIVE_SIGMA * sigma)
    assert packet_counts(air.radio)["lost: own channel"] == delays[None] == air.radio.counters[LOST_OWN]


def test_it_sees_the_packet(air: Any) -> None:
    """Each field becomes a delay: positions, time and delay by the network, length, ids and number."""
    fields = {
        "packet.time": 5.0,
        "packet.delay": 0.25,
        "packet.distance": 13.0,
        "packet.sender[2]": 7.0,
        "packet.receiver[0] + 10.0 * packet.receiver[1]": 3.0 + 40.0,
        "float(packet.length)": 21.0,  # of a HEARTBEAT
        "1.0 + packet.message": 1.0,
        "packet.system * 1.0": 9.0,
        "packet.number + 0.5": 1.5,
    }
    for text, value in fields.items():
        some = air(f"return {text}", latency=0.25)
        some.at("n0", 0.0, 0.0, 7.0)
        some.at("n1", 3.0, 4.0, -5.0)
        some.send(0, "n0", packet(1))
        some.send(5 * SECOND, "n0", packet(9))
        (last,) = [int(e["arrival"]) - int(e["sent"]) for e in some.events[-1:]]
        assert last == value * SECOND, text


@pytest.mark.parametrize("text", ["LOST", "-1e-9", "math.nan", "math.inf", "3601.0", "math.sqrt(-1.0)", "1.0 / -0.0"])
def test_a_delay_that_is_negative_or_none_or_longer_than_an_hour_is_a_loss(air: Any, text: str) -> None:
    some = air(f"return {text}")
    some.send(0, "n0", packet(1))
    assert some.outcomes() == {"lost: own channel": 1}


def test_other_effects_apply_to_what_it_lets_through(air: Any) -> None:
    """A fifth of the packets is lost at each of two stages; one that is late meets the outage of its receiver."""
    some = air("return packet.delay if chance(packet, 3) < 0.8 else LOST", loss=0.2, seed=3)
    spread(some, "n0", 10_000)
    counts = some.outcomes()
    assert counts["lost: own channel"] / 10_000 == pytest.approx(0.2, abs=0.02)
    assert counts["lost: channel"] / 10_000 == pytest.approx(0.16, abs=0.02)
    late = air("return 2.0", outages=(("n1", 1.5, 2.5),))
    late.send(0, "n0", packet(1))
    late.send(SECOND, "n0", packet(1))
    assert late.outcomes() == {"lost: outage": 1, "radio": 1}


# ---- random numbers -----------------------------------------------------------------------------------------------


def test_random_numbers_are_uniform_and_normal_and_independent() -> None:
    row = table(np.zeros(1, PACKET))
    uniform, gauss = np.empty((2, 5000)), np.empty(5000)
    for number in range(5000):
        row[0]["number"] = number
        row[0]["key"][:] = (2**64 - 1, 2**63 + 5, 17)
        uniform[:, number] = chance(row[0], 0), chance(row[0], 1)
        gauss[number] = normal(row[0], 2)
    assert ((uniform >= 0.0) & (uniform < 1.0)).all()
    for sample in (*uniform, 0.5 * (1.0 + np.array([math.erf(x / math.sqrt(2.0)) for x in gauss]))):
        below = np.sort(sample)
        assert np.abs(below - (np.arange(5000) + 0.5) / 5000).max() < 1.95 / math.sqrt(5000)  # Kolmogorov, 0.1 %
    assert abs(np.corrcoef(uniform)[0, 1]) < FIVE_SIGMA / math.sqrt(5000)


def test_fates_depend_on_seed_sender_receiver_and_number_only(tmp_path: Path) -> None:
    effect = own(tmp_path / "x.py", f"{HEAD}def channel(p: Packet) -> float:\n    return 0.1 + normal(p, 0) * 0.1\n")

    def fly(names: str, together: int, seed: int = 3) -> dict[Any, Any]:
        air = Air({name: [name] for name in names}, own=effect, seed=seed)
        for first in range(0, 120, together):
            for i, name in enumerate(names):
                air.send(first, name, b"".join(packet(i + 1, j) for j in range(first, first + together)))
        return {key: fate for key, fate in fates(air).items() if set(key[:2]) <= {"a", "b"}}

    assert len(fly("ab", 12)) == 240
    assert fly("ab", 12) == fly("ba", 12) == fly("cbda", 12)
    assert fly("ab", 12) != fly("ab", 12, seed=4)


# ---- files that are refused -----------------------------------------------------------------------------------------

BODY = f"{HEAD}def channel(packet: Packet) -> float:\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (BODY + "    return 1.0 +\n", ":4: is not Python: invalid syntax"),
        (HEAD, ":1: the function channel(packet) is missing; `uav-cosim new channel FILE` writes an example"),
        (
            HEAD + "def channel(a, b):\n    return 1.0\n",
            ":1: the function channel(packet) has one parameter, the packet",
        ),
        ("import os\n", ":1: os cannot be imported; valid are `import math` and `from cosim.channel import ...`"),
        ("from cosim.channel import lost\n", ':1: cosim.channel has no name "lost" for channels; '),
        (BODY + "    return open('x')\n", ':4: "open" cannot be called; '),
        (
            "from cosim.channel import chance\n" + BODY + "    return chance(packet, 0.5)\n",
            ":5: the second argument of chance is the number of a random number, a whole one; 0.5 is not",
        ),
        (
            "from cosim.channel import normal\nHALF = 0.5\n" + BODY + "    return normal(packet, 2 * HALF)\n",
            ":6: the second argument of normal is the number of a random number, a whole one; 2 * HALF is not",
        ),
        (BODY + "    return packet.__class__\n", ':4: a packet has no field "__class__"; '),
        (BODY + "    return packet.distence\n", ':4: a packet has no field "distence"; did you mean "distance"?'),
        (BODY + "    return packet.sender[3]\n", ":4: sender is read by its elements: sender[0] north, [1] east, [2]"),
        (BODY + "    return packet.time[0]\n", ":4: time is a single number"),
        (BODY + "    packet.time = 0.0\n    return 1.0\n", ":4: values are assigned to single names only"),
        (BODY + "    while True:\n        pass\n    return 1.0\n", ":4: `while True:` is not possible; a channel is"),
        (
            BODY + "    for i in range(2000):\n        pass\n    return 1.0\n",
            ":4: `range`: a loop has at most 1000 turns",
        ),
        (
            BODY + "    for i in range(packet.length):\n        pass\n    return 1.0\n",
            ":4: `range`: `packet.length` has",
        ),
        (BODY + "    if packet.time > 1.0:\n        return 1.0\n", ":3: channel can end without a result; end it with"),
        (BODY + "    if packet.time > 1.0:\n        x = 1.0\n    return x\n", ':6: there is no value "x"; '),
        (BODY + "    return channel(packet)\n", ':4: "channel" cannot be called; a function calls those above it only'),
        (BODY + "    return math.factorial(3)\n", ":4: math.factorial is not possible; "),
        (BODY + "    return chance(packet)\n", ":4: chance takes 2 arguments, not 1"),
        (BODY + "    return sum([1.0])\n", ':4: "sum" cannot be called; '),
        (BODY + "    return 'x'\n", ":4: 'x' is not a number up to 2^62"),
        (
            BODY + "    return False if packet.time > 9 else 1.0\n",
            ":4: `False` is no delay: return LOST to lose a packet",
        ),
        (
            BODY + "    if packet.time > 9:\n        return 1.0\n    return packet.time > 3\n",
            ":6: `packet.time > 3` is no",
        ),
        (BODY + "    return 1.0 if packet.time > 9 else not packet.time\n", ":4: `not packet.time` is no delay: "),
        ("A = 1 / 0\n" + BODY + "    return A\n", ":1: A is not a number: division by zero"),
        ("A = 2 ** 63\n" + BODY + "    return 1.0\n", ":1: A is not a number: `2 ** 63` has no value here; "),
        ("A = B\n" + BODY + "    return 1.0\n", ":1: A is not a number: `B` has no value here; "),
        ("print('x')\n" + BODY + "    return 1.0\n", ":1: `print('x')` is not possible here; valid: imports, NAME = "),
        ("@staticmethod\n" + BODY[len(HEAD) :] + "    return 1.0\n", ":2: channel has a decorator; remove it"),
    ],
)
def test_a_wrong_file(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "x.py").write_text(text, encoding="utf-8")
    problems: list[Problem] = []
    assert read_own_channel(tmp_path / "x.py", "x.py", problems) is None
    assert any(str(problem).startswith(f"{tmp_path / 'x.py'}{message}") for problem in problems), problems


def test_a_file_is_never_executed_by_reading_it(tmp_path: Path) -> None:
    made = tmp_path / "made"
    own(
        tmp_path / "x.py",
        f"{HEAD}def channel(p: open({str(made)!r}, 'w')) -> open({str(made)!r}, 'w'):\n    return 1.0",
    )
    assert not made.exists()


def test_an_annotation_is_never_evaluated(tmp_path: Path) -> None:
    made = tmp_path / "made"
    text = f"{HEAD}def channel(p: open({str(made)!r}, 'w')) -> open({str(made)!r}, 'w'):\n    return 1.0\n"
    each_alone(2, own=own(tmp_path / "x.py", text)).send(0, "n0", packet(1))
    assert not made.exists()


def test_deep_nesting_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.py").write_text(f"{BODY}    return {'+'.join(['1'] * 20_000)}\n")
    problems: list[Problem] = []
    assert read_own_channel(tmp_path / "x.py", "x.py", problems) is None
    assert "is nested too deeply" in str(problems[0])


def test_types_that_do_not_fit_are_reported_with_their_line(tmp_path: Path) -> None:
    found = own(tmp_path / "x.py", BODY + "    x = 1.0\n    return math.hypot(x, packet)\n")
    with pytest.raises(SystemDescriptionError) as caught:
        address_of(found)
    assert str(caught.value).startswith(f"{tmp_path / 'x.py'}:5: cannot be compiled: ")


@pytest.mark.parametrize("value", ["True", "packet.distance > 5", "math.isinf(packet.delay)"])
def test_a_value_that_is_no_number_is_told_as_such(tmp_path: Path, value: str) -> None:
    found = own(tmp_path / "x.py", BODY + f"    return {value}\n")
    with pytest.raises(SystemDescriptionError) as caught:
        address_of(found)
    line = BODY[: BODY.index("def channel")].count("\n") + 1
    text = (
        f"{tmp_path / 'x.py'}:{line}: channel returns no number: return the delay in s as a float, such as packet.delay"
    )
    assert str(caught.value).startswith(text)


def test_the_names_that_are_checked_are_those_that_exist() -> None:
    assert own_channel.FIELDS.keys() == {*(PACKET.names or ())} - {"key"}
    for name, size in own_channel.FIELDS.items():
        assert PACKET[name].shape == ((size,) if size else ())
    import cosim.channel

    assert {*own_channel.GIVEN} <= {*cosim.channel.__all__}


def test_every_function_of_math_that_is_allowed_compiles(tmp_path: Path) -> None:
    two = ("atan2", "hypot", "pow", "copysign")
    lines = [f"x = x + math.{name}(x{', x' if name in two else ''})" for name in sorted(own_channel._MATH)]
    address_of(own(tmp_path / "x.py", BODY + "    x = 0.5\n    " + "\n    ".join(lines) + "\n    return x\n"))
