"""Names that a user may have meant."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from cosim_master.diagnostics.names import divided, matching, near, similar

NAMES = ["drone1.vehicle.mass", "drone2.vehicle.mass", "drone1.vehicle.position[1]", "drone1.agent.gain"]


def test_names_are_similar_by_their_letters_their_case_and_their_ends() -> None:
    assert similar("drone1.vehicle.mas", NAMES) == ["drone1.vehicle.mass"]
    assert similar("Drone1.Agent.Gain", NAMES) == ["drone1.agent.gain"]
    assert similar("mass", NAMES) == ["drone1.vehicle.mass", "drone2.vehicle.mass"]
    assert similar("vehicle.position[1]", NAMES) == ["drone1.vehicle.position[1]"]
    assert similar("ass", NAMES) == []


def test_an_array_is_similar_to_its_elements_in_their_order() -> None:
    names = ["a.wind[1]", "a.wind[2]", "a.wind[3]", "a.wind[4]", "b.wind[1]", "a.mass"]
    for wrong in ("a.wind", "a.wind[0]", "a.Wind[5]"):
        assert similar(wrong, names) == ["a.wind[1]", "a.wind[2]", "a.wind[3]"]
    assert similar("a.mass[1]", names) == ["a.mass"]


def test_levels_may_be_missing() -> None:
    assert similar("drone1.mass", NAMES) == ["drone1.vehicle.mass"]
    assert similar("drone1.gain", NAMES) == ["drone1.agent.gain"]


def test_of_names_that_are_equally_similar_those_beside_it_come_first_in_their_order() -> None:
    names = [f"drone{n}.vehicle.{what}" for n in (5, 1, 2, 3, 4) for what in ("mass", "wind[1]")]
    assert similar("drone3.vehicle.wund[1]", names) == ["drone3.vehicle.wind[1]"]
    assert similar("drone7.vehicle.mass", names) == [f"drone{n}.vehicle.mass" for n in (5, 1, 2)]


def test_near_ends_a_sentence() -> None:
    assert near("mass", NAMES) == 'did you mean "drone1.vehicle.mass" or "drone2.vehicle.mass"?'
    assert near("nothing", NAMES[3:]) == 'valid: "drone1.agent.gain"'
    assert near("nothing", []) == "there is none"


@given(
    pattern=st.text("ab.*?[1]", max_size=8),
    prefixes=st.lists(st.text("ab.", max_size=3), min_size=1, max_size=4),
    names=st.lists(st.text("ab.[1]", min_size=1, max_size=3), min_size=1, max_size=6),
)
def test_a_divided_pattern_matches_what_the_whole_one_matches(
    pattern: str, prefixes: list[str], names: list[str]
) -> None:
    ways = divided(pattern, names)
    for prefix in prefixes:
        found = {prefix + name for head, rest in ways if head(prefix) for name in rest}
        assert found == {*matching(pattern, [prefix + name for name in names])}
