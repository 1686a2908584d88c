"""The formats of `uav-cosim export`: the only place where they are registered.

To add a format, write a module with a function `export` (an `Exporter`) and add a line to `FORMATS`. A module is
imported when it is used, since each needs a library of its own, which an extra of this project installs.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Protocol, cast

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where, WriteFailed
from cosim_master.files.whole import is_special, replacing
from cosim_master.results.export.options import Options
from cosim_master.results.storage.manifest_file import NAME, no_run

__all__ = ["FORMATS", "Exporter", "Format", "check_place", "export_run", "format_of"]


class Exporter(Protocol):
    """Writes the recording of a run in one format."""

    def __call__(self, run: Path, file: Path, options: Options) -> Sequence[str]:
        """Writes the file, or the files of a folder.

        Args:
            run: folder of the run.
            file: the file or the folder to write.
            options: settings.

        Returns:
            Notes for the user, about what the file does not contain.

        Raises:
            SystemDescriptionError: the folder holds no run, or the one to write is not empty.
            CosimError: the recording lacks data for this format.
            OSError: the file cannot be written.
        """
        ...


@dataclass(frozen=True, slots=True)
class Format:
    """A format.

    Attributes:
        name: of its module, and with hyphens of its option.
        text: the content, for the help.
        suffix: of its files, by which `-o` chooses it; empty for a folder.
        uses: the field of `Options` that its exporter reads, if any.
    """

    name: str
    text: str
    suffix: str = ""
    uses: str = ""

    @property
    def option(self) -> str:
        return f"--{self.name.replace('_', '-')}"

    @property
    def is_folder(self) -> bool:
        return not self.suffix


FORMATS = (
    Format("csv", "All signals as FMPy writes its results; - is standard output.", ".csv", uses="numbers_only"),
    Format("mat", "All signals as OpenModelica writes its results (MAT 4).", ".mat"),
    Format("mcap", "Poses, geodetic positions, signals, messages and a scene for Foxglove.", ".mcap", uses="origin"),
    Format("foxglove_layout", "Layout of Foxglove for --mcap and `run --foxglove`.", ".layout.json", uses="origin"),
    Format("rrd", "Scene, poses, signals and messages for Rerun.", ".rrd", uses="origin"),
    Format("rosbag", "ROS 2 bag: poses, odometry, NavSatFix, path, tf.", uses="origin"),
    Format("rosbag1", "ROS 1 bag with the same topics.", ".bag", uses="origin"),
    Format("tlog", "MAVLink packets of each node, with the sequence numbers of its link."),
    Format("dataflash", "ArduPilot's DataFlash log of each autopilot (runs with --dataflash).", uses="origin"),
    Format("kml", "Tracks for Google Earth.", ".kml", uses="origin"),
    Format("gpx", "Tracks for maps and GPS tools.", ".gpx", uses="origin"),
    Format("gif", "Animation of all drones, seen from above.", ".gif"),
    Format("mp4", "Film of all drones, seen from above.", ".mp4"),
)


def format_of(file: Path) -> Format:
    """Returns the format of a file by the end of its name; "-" is CSV.

    Raises:
        SystemDescriptionError: no format has such files.
    """
    if str(file) == "-":
        return FORMATS[0]
    for one in FORMATS:
        if one.suffix and file.name.lower().endswith(one.suffix):
            return one
    known = ", ".join(one.suffix for one in FORMATS if one.suffix)
    folders = ", ".join(f"{one.option} FOLDER" for one in FORMATS if one.is_folder)
    text = f"the end of the name must be one of {known}; {folders} write folders"
    raise SystemDescriptionError([Problem(Where(str(file)), text)])


def export_run(run: Path, one: Format, file: Path, options: Options) -> list[str]:
    """Writes a run in a format; returns notes. After an error, what was there before is still there.

    Raises:
        SystemDescriptionError: as `check_place`.
        CosimError: the recording lacks data for this format.
        WriteFailed: the file cannot be written.
        ModuleNotFoundError: the library of the format is not installed.
    """
    export = cast(Exporter, import_module(f"cosim_master.results.export.{one.name}").export)
    check_place(run, one, file)
    try:
        if str(file) == "-":
            return list(export(run, file, options))
        file.parent.mkdir(parents=True, exist_ok=True)
        with _new(file) if one.is_folder else replacing(file) as part:
            return list(export(run, part, options))
    except BrokenPipeError:
        if str(file) == "-":  # the reader has had enough, as `head` has
            raise
        raise WriteFailed(str(file), "its reader has gone") from None
    except OSError as error:
        raise WriteFailed(str(file), error.strerror or str(error)) from error


def check_place(run: Path, one: Format, file: Path) -> None:
    """Checks where a run is to be written in a format, before anything is written.

    Files have the end of the format's names, so that none takes the place of something else, such as the recording.

    Raises:
        SystemDescriptionError: the folder holds no run; or `file` is a folder or has the end of another kind of file;
            or the folder to be written is a file, or has something in it.
    """
    text = ""
    if not run.is_dir():
        file, text = run, no_run(run, NAME)
    elif one.is_folder:
        if file.is_dir() and any(file.iterdir()):
            text = f"the folder is not empty; give a new one for {one.option}"
        elif file.exists() and not file.is_dir():
            text = f"is a file; {one.option} writes a folder: give a new one"
    elif file.is_dir():
        text = f"is a folder; give the name of a file for {one.option}"
    elif not file.name.lower().endswith(one.suffix) and str(file) != "-" and not is_special(file):
        text = f"{one.option} writes files whose names end in {one.suffix}; try {file}{one.suffix}"
    if text:
        raise SystemDescriptionError([Problem(Where(str(file)), text)])


@contextmanager
def _new(folder: Path) -> Iterator[Path]:
    """Yields a folder that is new or empty, and makes it so again after an error."""
    existed = folder.exists()
    try:
        yield folder
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        if existed:
            folder.mkdir(exist_ok=True)
        raise
