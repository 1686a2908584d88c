"""Every format, read back by a reader that is independent of its writer: values equal to the recording."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections import Counter, defaultdict
from contextlib import nullcontext
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import fastkml
import gpx
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from DyMat import DyMatFile
from fmpy.util import read_csv
from lxml import etree
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from PIL import Image
from pymavlink import mavutil
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from scipy.io import loadmat

from cosim_master.diagnostics.errors import CosimError, SystemDescriptionError, WriteFailed
from cosim_master.results.export.contents import tracks as of_tracks
from cosim_master.results.export.formats import FORMATS, Format, export_run, format_of
from cosim_master.results.export.options import Options, origin_of_text
from tests.master.full_disk import room_of
from tests.master.results.export.conftest import edited, rotation
from tests.master.view import ros1

START = 1_735_689_600  # 2025-01-01T00:00:00Z
DRONES = [f"drone{i}" for i in range(1, 6)]
NAMED = {one.name: one for one in FORMATS}
# 100 m east of 35.363262 S, 149.165237 E on ArduPilot's sphere: 100 / (6378100 cos(35.363262 deg)) rad
EAST = 149.165237 + np.degrees(100.0 / (6378100.0 * np.cos(np.radians(-35.363262))))


@pytest.fixture(scope="module")
def table(flown: Path) -> pa.Table:
    return pq.read_table(flown / "signals.parquet")


def array(table: pa.Table, name: str, size: int) -> np.ndarray:
    return np.stack([table[f"{name}[{i + 1}]"].to_numpy() for i in range(size)], axis=1)


@pytest.mark.parametrize("one", FORMATS, ids=lambda one: one.name)
def test_a_format_declares_the_setting_that_it_uses(one: Format, begun: Path, tmp_path: Path) -> None:
    """Others are refused by `uav-cosim export`, as they would change nothing."""
    read: set[str] = set()

    class Asked:
        def __getattr__(self, name: str) -> Any:
            read.add(name)
            return getattr(Options(), name)

    asked: Any = Asked()
    with pytest.raises(CosimError, match="run with --dataflash") if one.name == "dataflash" else nullcontext():
        export_run(begun, one, tmp_path / f"file{one.suffix}", asked)
    assert read == {one.uses} - {""}


def test_the_flight_has_something_to_export(table: pa.Table, flown: Path) -> None:
    assert table.num_rows == 161 and array(table, "drone3.vehicle.position", 3)[-1, 2] < -3.0
    assert not np.allclose(array(table, "drone3.vehicle.attitude", 4)[-1], [1, 0, 0, 0], atol=1e-3)
    assert json.loads((flown / "manifest.json").read_text())["packets"]["lost"] > 50


def test_csv(exported: dict[str, Path], table: pa.Table) -> None:
    read = read_csv(exported["csv"])
    assert list(read.dtype.names) == table.column_names
    for name in table.column_names:
        np.testing.assert_array_equal(read[name], table[name].to_numpy().astype(float), err_msg=name)


def test_mat_as_modelica_tools_read_it(exported: dict[str, Path], table: pa.Table) -> None:
    raw = loadmat(exported["mat"], chars_as_strings=False)
    assert ["".join(row).strip() for row in raw["Aclass"]] == ["Atrajectory", "1.1", "", "binTrans"]
    assert raw["dataInfo"].dtype == np.int32 and raw["dataInfo"][:, 0].tolist() == [0, 1, 0, -1]
    read = DyMatFile(str(exported["mat"]))
    for name in table.column_names[1:]:
        np.testing.assert_array_equal(read.data(name), table[name].to_numpy().astype(float), err_msg=name)
        np.testing.assert_array_equal(read.abscissa(name)[0], table["time"].to_numpy())
    assert read.description("drone3.vehicle.position[2]").endswith("[m]")
    assert read.data("drone3.vehicle.mass").tolist() == [1.545, 1.545]


def test_mat_has_parameters_at_the_start_and_at_the_end(flown: Path, tmp_path: Path) -> None:
    def heavier(manifest: Any) -> None:
        name = "drone3.vehicle.mass"
        manifest["changes"] = [
            *(
                {"time": time, "variable": name, "value": value}
                for time, value in ((0.5, 1.7), (1.0, 2.0), (99.0, 9.0))
            ),
            {"time": 0.5, "variable": "drone3.agent.social", "value": True},
        ]

    export_run(edited(flown, tmp_path / "run", heavier), NAMED["mat"], tmp_path / "run.mat", Options())
    read = DyMatFile(str(tmp_path / "run.mat"))
    assert read.data("drone3.vehicle.mass").tolist() == [1.545, 2.0]
    assert read.data("drone2.vehicle.mass").tolist() == [1.545, 1.545]


def mcap_messages(file: Path) -> dict[str, list[tuple[int, Any]]]:
    found: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    with file.open("rb") as opened:
        for topic, stamp, decoded in _decoded(opened):
            found[topic].append((stamp, decoded))
    return found


def _decoded(opened: Any) -> Any:
    """Protobuf messages decoded by mcap_protobuf, JSON by Python."""
    factory = DecoderFactory()
    decoders: dict[int, Any] = {}
    for schema, channel, message in make_reader(opened).iter_messages():
        if channel.id not in decoders:
            decoders[channel.id] = factory.decoder_for(channel.message_encoding, schema) or json.loads
        yield channel.topic, message.log_time, decoders[channel.id](message.data)


def test_mcap(exported: dict[str, Path], table: pa.Table) -> None:
    topics = mcap_messages(exported["mcap"])
    stamps = [START * 10**9 + round(t * 1e9) for t in table["time"].to_pylist()]
    assert [stamp for stamp, _ in topics["/tf"]] == stamps
    for drone in DRONES:
        position = array(table, f"{drone}.vehicle.position", 3)
        attitude = array(table, f"{drone}.vehicle.attitude", 4)
        poses = topics[f"/{drone}/pose"]
        assert [stamp for stamp, _ in poses] == stamps and {pose.frame_id for _, pose in poses} == {"map"}
        places = np.array([[p.pose.position.x, p.pose.position.y, p.pose.position.z] for _, p in poses])
        np.testing.assert_array_equal(places, np.stack([position[:, 1], position[:, 0], -position[:, 2]], axis=1))
        check_orientation([pose.pose.orientation for _, pose in poses], attitude)
        frames = [next(f for f in tf.transforms if f.child_frame_id == drone) for _, tf in topics["/tf"]]
        assert [f.translation.x for f in frames] == position[:, 1].tolist()
        assert (frames[0].timestamp.seconds, frames[1].timestamp.nanos) == (START, 10**8)
        signals = [one for _, one in topics[f"/signals/{drone}.vehicle"]]
        assert [one["position"] for one in signals] == position.tolist()
        assert [one["on_ground"] for one in signals] == table[f"{drone}.vehicle.on_ground"].to_pylist()
    first = topics["/drone5/fix"][0][1]
    assert (first.latitude, first.longitude) == pytest.approx((-35.363262, EAST), abs=1e-9)
    assert first.altitude == pytest.approx(584.0, abs=1e-9)
    entities = topics["/scene"][0][1].entities
    assert [one.id for one in entities[:2]] == ["drone1", "drone1 path"] and len(entities[1].lines[0].points) == 161
    said = [(entry.name, entry.message) for _, entry in topics["/log"]]
    assert ("drone3", "Arming motors") in said or any(name == "drone3" for name, _ in said), said[:5]


def check_orientation(orientations: list[Any], attitude: np.ndarray) -> None:
    """The matrix from FLU to ENU is that from FRD to NED between two exchanges of axes."""
    to_enu = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])
    from_flu = np.diag([1, -1, -1])
    for q, a in zip(orientations[::20], attitude[::20], strict=True):
        found = rotation(np.array([q.w, q.x, q.y, q.z]))
        np.testing.assert_allclose(found, to_enu @ rotation(a) @ from_flu, atol=1e-12)


@pytest.mark.parametrize(("name", "types"), [("rosbag", Stores.ROS2_JAZZY), ("rosbag1", Stores.ROS1_NOETIC)])
def test_ros_bag(exported: dict[str, Path], table: pa.Table, name: str, types: Stores) -> None:
    found: dict[str, list[Any]] = defaultdict(list)
    with AnyReader([exported[name]], default_typestore=get_typestore(types)) as bag:
        for connection, stamp, data in bag.messages():
            message = bag.deserialize(data, connection.msgtype)
            found[connection.topic].append(message)
            header = message.transforms[0].header if connection.topic == "/tf" else message.header
            assert header.stamp.sec * 10**9 + header.stamp.nanosec == stamp
    assert set(found) == {"/tf", *(f"/{d}/{topic}" for d in DRONES for topic in ("pose", "odom", "fix", "path"))}
    for drone in DRONES:
        position = array(table, f"{drone}.vehicle.position", 3)
        velocity = array(table, f"{drone}.vehicle.velocity", 3)
        turning = array(table, f"{drone}.vehicle.angular_velocity", 3)
        attitude = array(table, f"{drone}.vehicle.attitude", 4)
        poses = [one.pose for one in found[f"/{drone}/pose"]]
        assert [(p.position.y, p.position.x, -p.position.z) for p in poses] == list(map(tuple, position.tolist()))
        check_orientation([p.orientation for p in poses], attitude)
        odometry = found[f"/{drone}/odom"]
        assert odometry[0].header.frame_id == "map" and odometry[0].child_frame_id == drone
        for k in range(0, 161, 20):
            forward, right, down = rotation(attitude[k]).T @ velocity[k]
            twist = odometry[k].twist.twist
            np.testing.assert_allclose(
                (twist.linear.x, twist.linear.y, twist.linear.z), (forward, -right, -down), atol=1e-12
            )
            p, q, r = turning[k]
            assert (twist.angular.x, twist.angular.y, twist.angular.z) == (p, -q, -r)
        assert len(found[f"/{drone}/path"][0].poses) == 161
    fix = found["/drone5/fix"][0]
    assert (fix.latitude, fix.longitude, fix.altitude) == pytest.approx((-35.363262, EAST, 584.0), abs=1e-9)
    assert [t.child_frame_id for t in found["/tf"][0].transforms] == DRONES


def test_a_bag_of_ros_1_is_read_by_ros(exported: dict[str, Path], table: pa.Table) -> None:
    """The types are those of Debian's messages, by their MD5 sums, and the values those of the recording."""
    if reason := ros1.lacking():
        pytest.skip(f"ROS 1: {reason}")
    code = (
        "import json, rosbag, sys\n"
        "from roslib.message import get_message_class\n"
        "bag = rosbag.Bag(sys.argv[1])\n"
        "info = bag.get_type_and_topic_info()\n"
        "same = {name: get_message_class(name)._md5sum == md5 for name, md5 in info.msg_types.items()}\n"
        "poses = [(m.header.stamp.to_nsec(), t.to_nsec(), m.pose.position.x, m.pose.position.y, m.pose.position.z)\n"
        "         for _, m, t in bag.read_messages(['/drone4/pose'])]\n"
        "print(json.dumps([same, {n: t.message_count for n, t in info.topics.items()}, poses]))\n"
    )
    command = [ros1.PYTHON, "-s", "-c", code, str(exported["rosbag1"])]
    done = subprocess.run(command, env=ros1.environment(0), capture_output=True, text=True, check=True)
    same, topics, poses = json.loads(done.stdout)
    assert same and all(same.values())
    assert topics["/tf"] == 161 and topics["/drone5/odom"] == 161 and topics["/drone1/path"] == 1
    time, position = table["time"].to_numpy(), array(table, "drone4.vehicle.position", 3)
    expected = [
        [START * 10**9 + round(t * 1e9)] * 2 + [east, north, -down]
        for t, (north, east, down) in zip(time.tolist(), position.tolist(), strict=True)
    ]
    assert poses == expected


def losses(log: Path) -> tuple[int, Counter[tuple[int, int]]]:
    """Gaps between the sequence numbers that pymavlink reads, as `mavloss` counts them, and the packets, by sender."""
    reader, read = mavutil.mavlink_connection(str(log), dialect="ardupilotmega"), Counter[tuple[int, int]]()
    last: dict[tuple[int, int], int] = {}
    lost = 0
    while (message := reader.recv_match()) is not None:
        assert message.get_type() != "BAD_DATA"
        of = message.get_srcSystem(), message.get_srcComponent()
        lost += (message.get_seq() - last.get(of, message.get_seq() - 1) - 1) % 256
        last[of] = message.get_seq()
        read[of] += 1
    reader.close()
    return lost, read


def test_tlog_has_the_losses_of_the_radio_and_no_others(exported: dict[str, Path], flown: Path) -> None:
    rows = pq.read_table(flown / "packets.parquet").to_pylist()
    for drone in DRONES:
        arrived: dict[tuple[int, int], list[float]] = defaultdict(list)
        lost: dict[tuple[int, int], list[float]] = defaultdict(list)
        for row in (row for row in rows if row["target"] == drone and row["outcome"] != "on board"):
            of = row["system"], row["component"]
            (lost[of] if row["outcome"] == "lost: channel" else arrived[of]).append(row["arrival"] or row["sent"])
        expected = sum(
            min(arrived[of]) < time < max(arrived[of]) for of, times in lost.items() if arrived[of] for time in times
        )
        counted, read = losses(exported["tlog"] / f"{drone}.tlog")
        assert counted == expected > 5
        for of, times in arrived.items():
            assert read[of] == len(times)
    recorded, _ = losses(flown / "packets" / "drone3.tlog")
    assert recorded > 2 * counted, "the recorded log itself is not misread any more: this export is not needed"


def test_tlog_keeps_times_and_payloads(exported: dict[str, Path], flown: Path) -> None:
    def messages(log: Path) -> list[tuple[float, str]]:
        reader = mavutil.mavlink_connection(str(log), dialect="ardupilotmega")
        found = []
        while (message := reader.recv_match()) is not None:
            found.append((message._timestamp, str(message.to_dict())))  # NaN is a valid value
        reader.close()
        return found

    assert messages(exported["tlog"] / "drone2.tlog") == messages(flown / "packets" / "drone2.tlog")


def test_mavloss_finds_no_loss_where_none_was(flown: Path, tmp_path: Path) -> None:
    """Without its packets that were lost, the same log has no gaps; MAVProxy's own tool says so."""
    run = tmp_path / "run"
    run.mkdir()
    (run / "packets").symlink_to(flown / "packets")
    whole = pq.read_table(flown / "packets.parquet")
    pq.write_table(whole.filter(pa.compute.equal(whole["outcome"], "radio")), run / "packets.parquet")
    export_run(run, NAMED["tlog"], tmp_path / "logs", Options())
    tool = Path(sys.executable).parent / "mavloss.py"
    said = subprocess.run(
        [sys.executable, tool, tmp_path / "logs" / "drone3.tlog"], capture_output=True, text=True, check=True
    ).stdout
    assert " packets, 0 lost 0.0%" in said, said


def test_kml_is_valid_and_has_the_places(exported: dict[str, Path], table: pa.Table) -> None:
    schema = etree.XMLSchema(etree.parse(Path(fastkml.__file__).parent / "schema" / "ogckml22.xsd"))
    document = etree.parse(exported["kml"])
    schema.assertValid(document)
    names = {"k": "http://www.opengis.net/kml/2.2", "gx": "http://www.google.com/kml/ext/2.2"}
    places = document.findall(".//k:Placemark", names)
    assert [place.findtext("k:name", None, names) for place in places] == DRONES
    whens = [one.text for one in places[4].findall("gx:Track/k:when", names)]
    assert (len(whens), whens[1]) == (161, "2025-01-01T00:00:00.100000Z")
    coordinates = np.array(
        [list(map(float, one.text.split())) for one in places[4].findall("gx:Track/gx:coord", names)]
    )
    assert coordinates[0] == pytest.approx((EAST, -35.363262, 584.0), abs=1e-9)
    down = table["drone5.vehicle.position[3]"].to_numpy()
    np.testing.assert_allclose(coordinates[:, 2], 584.0 - down, atol=1e-9)
    headings = [float(one.text.split()[0]) for one in places[4].findall("gx:Track/gx:angles", names)]
    w, x, y, z = array(table, "drone5.vehicle.attitude", 4).T
    yaw = np.degrees(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))) % 360
    np.testing.assert_allclose(np.cos(np.radians(headings - yaw)), 1.0, atol=1e-12)


def test_gpx_is_valid_and_has_the_places(exported: dict[str, Path], table: pa.Table) -> None:
    result = gpx.validate(exported["gpx"])
    assert result.is_valid, result
    read = gpx.read_gpx(exported["gpx"])
    assert [track.name for track in read.trk] == DRONES
    points = read.trk[4].trkseg[0].trkpt
    assert len(points) == 161
    assert (float(points[0].lat), float(points[0].lon)) == pytest.approx((-35.363262, EAST), abs=1e-9)
    down = table["drone5.vehicle.position[3]"].to_numpy()
    np.testing.assert_allclose([float(point.ele) for point in points], 584.0 - down, atol=1e-9)
    assert points[10].time == datetime.fromtimestamp(START + 1, UTC)


def test_gif_moves_the_drones(exported: dict[str, Path]) -> None:
    with Image.open(exported["gif"]) as animation:
        assert (animation.n_frames, animation.info["duration"]) == (120, 100)
        seen = []
        for frame in (0, 119):
            animation.seek(frame)
            pixels = np.asarray(animation.convert("RGB")).astype(int)
            green = np.abs(pixels - (0x00, 0x9E, 0x73)).sum(axis=2) < 60  # drone3
            seen.append(np.argwhere(green).mean(axis=0))
    assert np.isfinite(seen).all()
    down, right = seen[1] - seen[0]
    assert abs(down) + abs(right) > 0.5  # the wind moves it while it climbs


def test_positions_on_earth_are_those_that_the_autopilot_reports(exported: dict[str, Path], flown: Path) -> None:
    """GLOBAL_POSITION_INT of drone 3, which has 1e-7 degrees, against its track between recorded instants."""
    points = gpx.read_gpx(exported["gpx"]).trk[2].trkseg[0].trkpt
    places = np.array([(float(point.lat), float(point.lon)) for point in points])
    reader = mavutil.mavlink_connection(str(flown / "packets.tlog"), dialect="ardupilotmega")
    checked = 0
    while (message := reader.recv_match(type="GLOBAL_POSITION_INT")) is not None:
        if message.get_srcSystem() == 3 and message.lat != 0:  # its estimate is ready
            place = [np.interp(message.time_boot_ms / 1e3, np.arange(161) / 10, places[:, axis]) for axis in (0, 1)]
            assert (message.lat / 1e7, message.lon / 1e7) == pytest.approx(place, abs=2e-7)
            checked += 1
    reader.close()
    assert checked > 20


@pytest.mark.parametrize(("rate", "rows"), [(10.0, 161), (4.0, 55), (0.01, 2)])
def test_thinning_keeps_recorded_instants(flown: Path, rate: float, rows: int) -> None:
    """Every third of 161 instants, and the last one."""
    tracks = of_tracks.read_tracks(flown, Options())
    thinned = tracks.thinned(rate)
    assert len(thinned.time) == rows and thinned.time[-1] == 16.0
    assert set(thinned.time) <= set(tracks.time)


def test_origins(flown: Path, tmp_path: Path) -> None:
    def undeclared(manifest: Any) -> None:
        for fmu in manifest["fmus"].values():
            fmu["verdicts"] = {n: v for n, v in fmu["verdicts"].items() if not v["is"].startswith("Origin")}

    def different(manifest: Any) -> None:
        manifest["instances"]["drone4.autopilot"]["parameters"]["origin_latitude"] = 0.1

    run = edited(flown, tmp_path / "a", undeclared)
    for name in ("kml", "gpx"):
        with pytest.raises(CosimError, match=r"no FMU of the run declares the local origin .*; try --origin LATITUDE"):
            export_run(run, NAMED[name], tmp_path / f"no.{name}", Options())
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a"]
    export_run(run, NAMED["gpx"], tmp_path / "a.gpx", Options(origin=origin_of_text("48.1,11.6,520")))
    point = gpx.read_gpx(tmp_path / "a.gpx").trk[0].trkseg[0].trkpt[0]
    assert (float(point.lat), float(point.lon), float(point.ele)) == pytest.approx((48.1, 11.6, 520.0))
    with pytest.raises(CosimError, match=r"drone1\.agent and drone4\.autopilot declare different local origins"):
        export_run(edited(flown, tmp_path / "b", different), NAMED["kml"], tmp_path / "b.kml", Options())


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
@pytest.mark.parametrize("name", ["csv", "kml", "gpx", "mat"])
def test_a_full_disk(flown: Path, name: str) -> None:
    with pytest.raises(CosimError, match=r"^/dev/full: cannot be written: No space left on device$"):
        export_run(flown, NAMED[name], Path("/dev/full"), Options())


@pytest.mark.parametrize("text", ["48.1", "48.1,11.6,high", "95,0,0", "nan,0,0", "1,2,3,4"])
def test_an_origin_that_is_no_place(text: str) -> None:
    with pytest.raises(CosimError, match=f"origin {text}: "):
        origin_of_text(text)


def test_formats_by_the_end_of_a_name() -> None:
    assert [format_of(Path(f"x{one.suffix}")) for one in FORMATS if one.suffix] == [
        one for one in FORMATS if one.suffix
    ]
    assert format_of(Path("-")).name == "csv" and format_of(Path("A.KML")).name == "kml"
    with pytest.raises(CosimError, match=r"x\.txt: the end of the name must be one of \.csv, .* --rosbag FOLDER"):
        format_of(Path("x.txt"))


def test_a_folder_with_something_in_it_is_left_alone(flown: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("x")
    for name in ("rosbag", "tlog"):
        with pytest.raises(CosimError, match="the folder is not empty; give a new one"):
            export_run(flown, NAMED[name], tmp_path, Options())
    assert [file.name for file in tmp_path.iterdir()] == ["mine"]


def test_a_run_without_packets_or_vehicles(tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    pq.write_table(pa.table({"time": [0.0], "tank.level": [1.0]}), run / "signals.parquet")
    (run / "manifest.json").write_text('{"instances": {}}')
    with pytest.raises(CosimError, match=r"no packets were recorded"):
        export_run(run, NAMED["tlog"], tmp_path / "logs", Options())
    for name in ("mcap", "rosbag", "rrd", "kml", "gpx"):
        with pytest.raises(
            CosimError, match=r"nothing to export: the run recorded no component with position\[1\.\.3\]"
        ):
            export_run(run, NAMED[name], tmp_path / f"x{NAMED[name].suffix}", Options())
    assert sorted(file.name for file in tmp_path.iterdir()) == ["run"]


@pytest.mark.parametrize("one", [one for one in FORMATS if one.suffix], ids=lambda one: one.name)
def test_without_room_the_file_before_stays(begun: Path, tmp_path: Path, one: Format) -> None:
    file = tmp_path / f"x{one.suffix}"
    file.write_bytes(b"before")
    with room_of(500), pytest.raises(WriteFailed, match=rf"^{re.escape(str(file))}: cannot be written: "):
        export_run(begun, one, file, Options())
    assert file.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [file]


@pytest.mark.parametrize("one", FORMATS, ids=lambda one: one.name)
def test_nothing_takes_the_place_of_another_kind_of_file(flown: Path, tmp_path: Path, one: Format) -> None:
    """Of the recording, above all, which `--csv out/line5/signals.parquet` would have replaced."""
    file = tmp_path / "signals.parquet"
    file.write_bytes(b"before")
    writes = f"writes files whose names end in {one.suffix}; try {file}{one.suffix}"
    text = f"{one.option} {writes}" if one.suffix else f"is a file; {one.option} writes a folder: give a new one"
    with pytest.raises(SystemDescriptionError, match=re.escape(f"{file}: {text}")):
        export_run(flown, one, file, Options())
    if one.suffix:
        (folder := tmp_path / f"y{one.suffix}").mkdir()
        with pytest.raises(SystemDescriptionError, match=f"is a folder; give the name of a file for {one.option}"):
            export_run(flown, one, folder, Options())
    assert file.read_bytes() == b"before"


@pytest.mark.parametrize(
    ("name", "package", "extra"),
    [
        ("mcap", "foxglove", "export"),
        ("rosbag", "rosbags", "export"),
        ("mat", "scipy", "export"),
        ("gpx", "gpxpy", "export"),
        ("rrd", "rerun", "rerun"),
        ("mp4", "av", "film"),
    ],
)
def test_a_missing_library_names_its_extra(
    name: str, package: str, extra: str, flown: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from typer.testing import CliRunner

    from cosim_master.cli import app

    for module in [m for m in sys.modules if m == package or m.startswith(f"{package}.")]:
        monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setitem(sys.modules, package, None)
    done = CliRunner().invoke(app, ["export", str(flown), f"--{name}", str(tmp_path / f"x{NAMED[name].suffix}")])
    assert done.exit_code == 2
    assert done.stderr.splitlines()[-1] == f"error: {package} is not installed; try pip install 'uav-cosim[{extra}]'"


def test_a_folder_that_was_empty_is_empty_again_after_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def export(run: Path, file: Path, options: Options) -> list[str]:
        file.mkdir(exist_ok=True)
        (file / "half.tlog").write_text("x")
        raise OSError(28, "No space left on device")

    (tmp_path / "run").mkdir()
    (tmp_path / "logs").mkdir()
    monkeypatch.setattr("cosim_master.results.export.tlog.export", export)
    for name in ("logs", "new"):
        with pytest.raises(WriteFailed, match=f"{name}: cannot be written: No space left on device"):
            export_run(tmp_path / "run", NAMED["tlog"], tmp_path / name, Options())
    assert list((tmp_path / "logs").iterdir()) == [] and not (tmp_path / "new").exists()
