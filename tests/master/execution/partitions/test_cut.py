"""Files that assign units to parts."""

from __future__ import annotations

from pathlib import Path

import pytest

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.partitions.cut import read_assignment


def test_a_file_names_the_units_and_the_machine_of_each_part(tmp_path: Path) -> None:
    file = tmp_path / "parts.json"
    file.write_text('{"parts": [{"units": ["drone1", "drone2*"]}, {"units": [], "host": "node7"}]}')
    found = read_assignment(file, 2)
    assert (found.patterns, found.hosts) == ((("drone1", "drone2*"), ()), ("", "node7"))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('{"parts": [{"units": "drone1"}, {"units": ["drone2"]}]}', r'units is "drone1", not a list of names'),
        ('{"parts": [{"units": ["drone1"]}]}', "it has 1 parts, the run has 2"),
        ('{"parts": [{"units": [], "hots": "a"}, {"units": []}]}', "hots is not known"),
    ],
)
def test_a_file_in_another_form_is_refused(tmp_path: Path, text: str, says: str) -> None:
    file = tmp_path / "parts.json"
    file.write_text(text)
    with pytest.raises(SystemDescriptionError, match=says):
        read_assignment(file, 2)
