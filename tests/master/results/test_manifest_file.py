"""manifest.json: written in pieces, with the lines of its first levels, and updated in place."""

from __future__ import annotations

import json
from collections import ChainMap
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cosim_master.results.storage.manifest_file import NAME, RunningManifest, write_manifest

CONTENT: dict[str, Any] = {
    "outcome": "running",
    "ünder": {'a\n"b': [1, 2.5, None], "empty": {}, "none": []},
    "instances": {"drone1": {"parameters": {"x": 1.0, "y": [True, {"deep": "text\nof lines"}]}}, "drone2": {}},
    "half": "\udc80",
    "packets": {"sent": 0, "lost": 0},
    "list": [[1, [2, [3, [4]]]], {"a": 1}],
}


def whole(value: Any, levels: int) -> str:
    """The text as a whole: an independent form of the same layout."""
    if not levels or not value or not isinstance(value, (dict, list)):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, dict):
        lines = [f"{json.dumps(name, ensure_ascii=False)}: {whole(one, levels - 1)}" for name, one in value.items()]
    else:
        lines = [whole(one, levels - 1) for one in value]
    opening, closing = "{}" if isinstance(value, dict) else "[]"
    return f"{opening}\n " + ",\n".join(lines).replace("\n", "\n ") + f"\n{closing}"


def test_pieces_make_the_whole(tmp_path: Path) -> None:
    write_manifest(tmp_path, CONTENT)
    data = (tmp_path / NAME).read_bytes()
    assert data == (whole(CONTENT, 3) + "\n").encode("utf-8", "backslashreplace")
    assert json.loads(data) == CONTENT


def test_layers_that_instances_share_are_written_with_each(tmp_path: Path) -> None:
    shared: dict[str, Any] = {"mass": 1.5, "na\u00efve": "a\nb", "on": True}
    layers = [
        ChainMap({"on": False, "own": 1e-5}, shared),
        ChainMap({}, shared),
        ChainMap({}, {}),
        ChainMap({"a": 1}, {}),
    ]
    layered = {f"drone{i}": {"parameters": one} for i, one in enumerate(layers)}
    write_manifest(tmp_path, {"instances": layered})
    plain = {name: {"parameters": dict(one["parameters"])} for name, one in layered.items()}
    assert plain["drone0"]["parameters"] == {"mass": 1.5, "na\u00efve": "a\nb", "on": False, "own": 1e-5}
    assert (tmp_path / NAME).read_text(encoding="utf-8") == whole({"instances": plain}, 3) + "\n"


@given(
    st.lists(st.floats(allow_nan=False, allow_infinity=False) | st.integers() | st.booleans(), min_size=1),
    st.sampled_from([dict, ChainMap]),
)
def test_numbers_are_written_as_by_python(numbers: list[float], kind: Callable[[dict[str, float]], Any]) -> None:
    values = {f"v{i}": one for i, one in enumerate(numbers)}
    with TemporaryDirectory() as folder:
        write_manifest(Path(folder), {"a": {"b": {"c": kind(values)}}})
        written = (Path(folder) / NAME).read_text(encoding="utf-8")
    assert written == whole({"a": {"b": {"c": values}}}, 3) + "\n"


@pytest.mark.parametrize("number", [float("nan"), float("inf"), float("-inf")])
def test_a_number_that_json_has_not_is_refused(tmp_path: Path, number: float) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_manifest(tmp_path, {"a": {"b": {"c": number}}})


def test_values_are_updated_in_place(tmp_path: Path) -> None:
    manifest = RunningManifest(tmp_path, CONTENT, "outcome", "packets")
    before = (tmp_path / NAME).read_bytes()
    assert json.loads(before) == CONTENT
    manifest.update({"outcome": "failed", "packets": {"sent": 123456, "lost": 7}})
    manifest.close()
    after = (tmp_path / NAME).read_bytes()
    assert len(after) == len(before)
    assert json.loads(after) == {**CONTENT, "outcome": "failed", "packets": {"sent": 123456, "lost": 7}}
