"""Names that a user may have meant."""

from __future__ import annotations

from cosim_master.diagnostics.names import near, similar

NAMES = ["drone1.vehicle.mass", "drone2.vehicle.mass", "drone1.vehicle.position[1]", "drone1.agent.gain"]


def test_names_are_similar_by_their_letters_their_case_and_their_ends() -> None:
    assert similar("drone1.vehicle.mas", NAMES) == ["drone1.vehicle.mass"]
    assert similar("Drone1.Agent.Gain", NAMES) == ["drone1.agent.gain"]
    assert similar("mass", NAMES) == ["drone1.vehicle.mass", "drone2.vehicle.mass"]
    assert similar("vehicle.position[1]", NAMES) == ["drone1.vehicle.position[1]"]
    assert similar("ass", NAMES) == []


def test_near_ends_a_sentence() -> None:
    assert near("mass", NAMES) == 'did you mean "drone1.vehicle.mass" or "drone2.vehicle.mass"?'
    assert near("nothing", NAMES[3:]) == 'valid: "drone1.agent.gain"'
    assert near("nothing", []) == "there is none"
