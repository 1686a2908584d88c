"""Archives from strangers are refused for what they are, and nothing is written outside."""

from __future__ import annotations

import io
import stat
import zipfile
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.files import archive
from tests.master.full_disk import room_of


def made(path: Path, *entries: tuple[zipfile.ZipInfo | str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w") as file:
        for entry, data in entries:
            file.writestr(entry, data)
    return path


def link(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name)
    entry.create_system = 3
    entry.external_attr = (stat.S_IFLNK | 0o777) << 16
    return entry


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("../evil", "outside of the folder"),
        ("a/../../evil", "outside of the folder"),
        ("/etc/evil", "outside of the folder"),
        ("C:/evil", "outside of the folder"),
        ("a\\evil", "backslash"),
        (link("evil"), "is a link"),
    ],
    ids=str,
)
def test_refused_entries(tmp_path: Path, entry: zipfile.ZipInfo | str, message: str) -> None:
    path = made(tmp_path / "a.zip", ("fine", b"1"), (entry, b"/etc/passwd"))
    target = tmp_path / "in" / "out"
    with pytest.raises(SystemDescriptionError, match=message):
        archive.unpack(path, target, "a.zip")
    assert not target.exists()
    assert not list(tmp_path.rglob("evil"))


def test_encrypted_entries_are_refused(tmp_path: Path) -> None:
    data = bytearray(made(tmp_path / "a.zip", ("secret", b"1")).read_bytes())
    for signature, offset in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        data[data.index(signature) + offset] |= 1
    (tmp_path / "a.zip").write_bytes(data)
    with pytest.raises(SystemDescriptionError, match=r'a\.zip: entry "secret" is encrypted'):
        archive.unpack(tmp_path / "a.zip", tmp_path / "out", "a.zip")


def test_other_compressions_are_refused(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_BZIP2) as file:
        file.writestr("x", b"1" * 100)
    with pytest.raises(SystemDescriptionError, match="compression method 12"):
        archive.member_names(tmp_path / "a.zip", "a.zip")


def test_bombs_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archive, "MAX_BYTES", 1000)
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("x", b"0" * 1001)
    with pytest.raises(SystemDescriptionError, match="unpacks to more than 1000 bytes"):
        archive.unpack(tmp_path / "a.zip", tmp_path / "out", "a.zip")
    monkeypatch.setattr(archive, "MAX_ENTRIES", 1)
    made(tmp_path / "b.zip", ("x", b""), ("y", b""))
    with pytest.raises(SystemDescriptionError, match="more than 1 entries"):
        archive.member_names(tmp_path / "b.zip", "b.zip")


def test_packing_that_fails_leaves_nothing(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("a")
    with pytest.raises(FileNotFoundError):
        archive.pack({"a": tmp_path / "a", "b": tmp_path / "gone"}, tmp_path / "a.zip")
    assert [file.name for file in tmp_path.iterdir()] == ["a"]


def test_a_size_that_is_a_lie_is_found_while_unpacking(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = bytearray(made(tmp_path / "a.zip", ("x", b"0" * 2000)).read_bytes())
    at = data.index(b"PK\x01\x02")
    data[at + 24 : at + 28] = (10).to_bytes(4, "little")
    (tmp_path / "a.zip").write_bytes(data)
    monkeypatch.setattr(archive, "MAX_BYTES", 1000)
    with pytest.raises(SystemDescriptionError):
        archive.unpack(tmp_path / "a.zip", tmp_path / "out", "a.zip")
    assert (tmp_path / "out/x").stat().st_size <= 1000


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_one_name_for_two_files_is_refused(tmp_path: Path) -> None:
    """Readers differ in which of the two they take, so that one may have checked another file than we run."""
    for content, fine in ((b"one", True), (b"two", False)):
        with zipfile.ZipFile(tmp_path / "a.zip", "w") as file:
            file.writestr("a.txt", b"one")
            file.writestr("a.txt", content)
        if fine:
            assert archive.read_member(tmp_path / "a.zip", "a.txt", "a.zip", limit=10) == b"one"
            continue
        with pytest.raises(SystemDescriptionError, match=r'entry "a\.txt" is there twice, with different contents'):
            archive.unpack(tmp_path / "a.zip", tmp_path / "out", "a.zip")


def test_folders_and_programs(tmp_path: Path) -> None:
    program = zipfile.ZipInfo("bin/tool")
    program.external_attr = (stat.S_IFREG | 0o755) << 16
    archive.unpack(made(tmp_path / "a.zip", ("empty/", b""), (program, b"#!")), tmp_path / "out", "a.zip")
    assert (tmp_path / "out/empty").is_dir()
    assert (tmp_path / "out/bin/tool").stat().st_mode & stat.S_IXUSR


def test_a_member_larger_than_wanted_is_refused(tmp_path: Path) -> None:
    path = made(tmp_path / "a.zip", ("x", b"12345"))
    assert archive.read_member(path, "x", "a.zip", limit=5) == b"12345"
    assert archive.read_member(path, "y", "a.zip", limit=5) is None
    with pytest.raises(SystemDescriptionError, match='"x" is larger than 4 bytes'):
        archive.read_member(path, "x", "a.zip", limit=4)


def test_not_an_archive_and_no_file(tmp_path: Path) -> None:
    (tmp_path / "a.zip").write_bytes(b"PK but not really")
    with pytest.raises(SystemDescriptionError, match=r"a\.zip: not a readable ZIP archive"):
        archive.member_names(tmp_path / "a.zip", "a.zip")
    with pytest.raises(SystemDescriptionError, match=r"b\.zip: no such file"):
        archive.member_names(tmp_path / "b.zip", "b.zip")


def test_no_room_for_the_files(tmp_path: Path) -> None:
    """The archive is not to blame."""
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as made:
        made.writestr("large", b"x" * 5000)
    error = r"a\.zip: cannot be unpacked to \S+out: File too large"
    with room_of(4096), pytest.raises(SystemDescriptionError, match=error):
        archive.unpack(tmp_path / "a.zip", tmp_path / "out", "a.zip")


def test_pack_and_unpack_and_the_same_bytes_again(tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(bytes(range(256)))
    (tmp_path / "y").write_text("text")
    files = {"folder/x": tmp_path / "x", "y": tmp_path / "y"}
    archive.pack(files, tmp_path / "one.zip")
    archive.pack(dict(reversed(files.items())), tmp_path / "two.zip")
    assert (tmp_path / "one.zip").read_bytes() == (tmp_path / "two.zip").read_bytes()
    archive.unpack(tmp_path / "one.zip", tmp_path / "out", "one.zip")
    assert (tmp_path / "out/folder/x").read_bytes() == bytes(range(256))
    assert archive.member_names(tmp_path / "one.zip", "") == ("folder/x", "y")


@settings(max_examples=120, deadline=None)
@given(st.data())
def test_damaged_archives_give_our_error_or_nothing(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("a/b.txt", b"hello " * 20)
        file.writestr("c.txt", b"world")
    damaged = bytearray(buffer.getvalue())
    for _ in range(data.draw(st.integers(1, 6))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    folder = tmp_path_factory.mktemp("damaged")
    (folder / "a.zip").write_bytes(damaged[: data.draw(st.integers(0, len(damaged)))])
    try:
        archive.unpack(folder / "a.zip", folder / "out", "a.zip")
    except SystemDescriptionError:
        return
    assert {path.relative_to(folder).parts[0] for path in folder.rglob("*")} <= {"a.zip", "out"}
