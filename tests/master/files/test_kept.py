"""Kept files are loaded only if they are those that were made, from a folder that others cannot write to."""

from __future__ import annotations

import logging
import os
import stat
import zipfile
from pathlib import Path

import pytest

from cosim.kernel import cache_folder
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.files.kept import intact, intact_copy, private_cache, seal
from cosim_master.fmi.isolation import building


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return cache_folder()


def test_the_folder_is_the_users_alone(cache: Path) -> None:
    """A new one, and one that others could read or write."""
    assert stat.S_IMODE(private_cache().stat().st_mode) == 0o700
    cache.chmod(0o777)
    assert stat.S_IMODE(private_cache().stat().st_mode) == 0o700


def test_a_folder_of_another_user_is_refused(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Unless it is root's, and only root can write to it."""
    private_cache()
    monkeypatch.setattr(os, "geteuid", lambda: 4711)
    if cache.stat().st_uid == 0:
        assert private_cache() == cache
        cache.chmod(0o757)
    with pytest.raises(SystemDescriptionError, match="others can write to it; set XDG_CACHE_HOME to a folder of your"):
        private_cache()


def test_a_changed_file_is_not_intact(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = tmp_path / "library.so"
    assert not intact(file)
    file.write_bytes(b"code")
    assert not intact(file)  # without a digest
    seal(file)
    assert intact(file)
    file.write_bytes(b"c0de")
    with caplog.at_level(logging.WARNING):
        assert not intact(file)
    assert f"{file} has been changed since it was made" in caplog.text


def test_a_copy_of_an_archive(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.fmu", "w") as archive:
        archive.writestr("resources/model.py", "x = 1")
    (tmp_path / "copy" / "resources").mkdir(parents=True)
    assert not intact_copy(tmp_path / "a.fmu", tmp_path / "copy")
    file = tmp_path / "copy" / "resources" / "model.py"
    file.write_text("x = 1")
    (file.parent / "more.txt").touch()
    assert intact_copy(tmp_path / "a.fmu", tmp_path / "copy")
    file.write_text("x = 2")
    assert not intact_copy(tmp_path / "a.fmu", tmp_path / "copy")


def test_a_changed_program_of_isolation_is_made_anew(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its C compiler is replaced by one that only writes the name of the file."""

    def compiled(folder: Path) -> None:
        for name in (building.LIBRARY, building.HOST):
            (folder / name).write_text(f"made {name}")

    monkeypatch.setattr(building, "_compile", compiled)
    find = building.binaries.__wrapped__
    folder = find()
    assert folder.parent == cache / "isolation"
    host = folder / building.HOST
    assert host.read_text() == "made host"
    made = host.stat().st_ino
    assert find() == folder
    assert host.stat().st_ino == made
    host.write_text("other")
    assert find() == folder
    assert host.read_text() == "made host"
    assert [path.name for path in folder.parent.iterdir()] == [folder.name]
