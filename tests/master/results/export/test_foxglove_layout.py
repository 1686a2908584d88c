"""The layout of Foxglove refers to topics that the MCAP file has, with the types that its panels show."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from cosim_master.results.export.formats import export_run, format_of
from cosim_master.results.export.options import Options
from tests.master.results.export.conftest import edited


def panels(content: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    if content["type"] == "panel":
        yield content
    for item in content.get("items", ()):
        assert item["proportion"] > 0
        yield from panels(item["content"])


def in_mcap(file: Path) -> dict[str, tuple[str, list[Any]]]:
    """Schema and decoded messages of each topic with a schema of Foxglove."""
    found: dict[str, tuple[str, list[Any]]] = {}
    factory = DecoderFactory()
    with file.open("rb") as opened:
        for schema, channel, message in make_reader(opened).iter_messages():
            if channel.message_encoding == "protobuf":
                decoder = factory.decoder_for("protobuf", schema)
                assert schema is not None and decoder is not None
                found.setdefault(channel.topic, (schema.name, []))[1].append(decoder(message.data))
    return found


def test_panels_show_what_is_in_the_file(exported: Mapping[str, Path], flown: Path) -> None:
    layout = json.loads(exported["foxglove_layout"].read_text())
    topics = in_mcap(exported["mcap"])
    of = {name: schema for name, (schema, _) in topics.items()}
    assert layout["version"] == 1
    found = [*panels(layout["content"])]
    assert [one["panelType"] for one in found] == ["ThreeDee", "Map", "Plot", "Plot", "Plot", "Log"]
    scene, map_, *plots, words = [one["config"] for one in found]
    assert {of[topic] for topic in scene["topics"]} == {"foxglove.SceneUpdate"}
    frames = {f.parent_frame_id for tf in topics["/tf"][1] for f in tf.transforms}
    assert frames == {scene["fixedFrame"]} == {scene["followTf"]} == {scene["layers"]["grid"]["frameId"]}
    assert {of[topic] for topic in map_["topicConfig"]} == {"foxglove.LocationFix"} and len(map_["topicConfig"]) == 5
    assert map_["followTopic"] in map_["topicConfig"]
    assert of[words["topicToRender"]] == "foxglove.Log"
    signals = pq.read_table(flown / "signals.parquet")
    for plot, (element, sign) in zip(plots, [(2, 1.0), (1, 1.0), (3, -1.0)], strict=True):
        assert [series["label"] for series in plot["paths"]] == [f"drone{i}" for i in range(1, 6)]
        for series in plot["paths"]:
            topic, _, path = series["value"].partition(".")
            values = topics[topic][1]
            for field in path.split("."):
                values = [getattr(value, field) for value in values]
            recorded = signals[f"{series['label']}.vehicle.position[{element}]"].to_numpy()
            np.testing.assert_array_equal(values, sign * recorded)


def test_a_run_somewhere_with_other_names(flown: Path, tmp_path: Path) -> None:
    """Without a place on Earth there is no map; topics that are no words are quoted."""

    def undeclared(manifest: Any) -> None:
        for fmu in manifest["fmus"].values():
            fmu["verdicts"] = {}

    run = edited(flown, tmp_path / "run", undeclared)
    table = pq.read_table(flown / "signals.parquet")
    metadata = [field for field in table.schema if field.name == "time" or "drone1.vehicle.position" in field.name]
    (run / "signals.parquet").unlink()
    few = table.select([field.name for field in metadata])
    pq.write_table(
        few.rename_columns([re.sub("drone1", "a-b c", n) for n in few.column_names]), run / "signals.parquet"
    )
    assert format_of(Path("x.LAYOUT.json")).name == "foxglove_layout"
    export_run(run, format_of(Path("x.layout.json")), tmp_path / "x.layout.json", Options())
    found = [*panels(json.loads((tmp_path / "x.layout.json").read_text())["content"])]
    assert "Map" not in {one["panelType"] for one in found}
    assert found[1]["config"]["paths"][0]["value"] == '"/a-b c/pose".pose.position.x'


@pytest.mark.parametrize("name", ["x.json", "layout.json.csv.x"])
def test_other_json_files_are_no_layouts(name: str) -> None:
    with pytest.raises(Exception, match=r"the end of the name must be one of .*\.layout\.json"):
        format_of(Path(name))
