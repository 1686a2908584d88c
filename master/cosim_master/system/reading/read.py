"""Reads a system (an .ssd file, an .ssp archive or a folder) and all files that it refers to as a `SystemStructure`.

SSP 1.0 and 2.0 are supported. Features that cannot be run are problems with file and line. Contents unknown to the
standard are reported with the valid alternatives. Geometry is skipped, since it is for drawing only.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.names import near
from cosim_master.system import shipped
from cosim_master.system.reading.others.into_cps import read_multimodel
from cosim_master.system.reading.others.mastersim import read_mastersim
from cosim_master.system.reading.others.osp import OSP_DOCUMENT, read_osp
from cosim_master.system.reading.single_fmu import read_fmu
from cosim_master.system.reading.ssp.references import File, Files, parsed
from cosim_master.system.reading.ssp.ssd import COMPONENT_TYPES, FMU_TYPE, ROOT_DOCUMENT, SSD_TYPE, SSP_TYPE, Document
from cosim_master.system.structure import SystemStructure

__all__ = ["COMPONENT_TYPES", "FMU_TYPE", "ROOT_DOCUMENT", "SSD_TYPE", "SSP_TYPE", "read_system"]


_OTHERS: Mapping[str, tuple[str, Callable[[Path], SystemStructure]]] = {
    ".fmu": ("an FMU", read_fmu),
    ".json": ("a multi-model", read_multimodel),
    ".xml": ("a structure of OSP", read_osp),
    ".msim": ("a project of MasterSim", read_mastersim),
}
"""Files that are not SSP, by their suffix: what they are, and their reader."""

_RUNS = 6
"""Runs that an error names."""


def read_system(path: str | PathLike[str], variant: str | None = None) -> SystemStructure:
    """Reads a system structure and all files that it refers to, except the contents of FMUs.

    Args:
        path: an .ssd file, an .ssp archive, a folder with a SystemStructure.ssd, a multi-model (.json), an
            OspSystemStructure.xml or a folder with it, a project of MasterSim (.msim), an FMU, which is then the only
            component of a system, or, if no such file exists, the name of a shipped system.
        variant: selects an .ssd at the root of the archive or folder, by the name of the description in it, or of its
            file. None: SystemStructure.ssd.

    Returns:
        The structure. The errors in its files are in `problems`, so that `check` can report them together with the
        errors of FMUs and connections. Close it to remove an unpacked archive.

    Raises:
        SystemDescriptionError: the root document cannot be read, or the variant does not exist.
    """
    given = Path(path)
    if not given.exists():
        given = _shipped(str(given))
    place = given.absolute()
    files = Files()
    if given.is_dir() and not (given / ROOT_DOCUMENT).is_file() and (given / OSP_DOCUMENT).is_file():
        given = given / OSP_DOCUMENT
    if (other := _OTHERS.get(given.suffix.lower())) is not None and not given.is_dir():
        what, read = other
        if variant is not None:
            message = f'{what} has no variants; give it without --variant "{variant}"'
            raise SystemDescriptionError([Problem(Where(str(given)), message)])
        return read(given)
    try:
        if given.is_dir():
            root = _chosen(File(place, str(given)), variant, files)
        elif given.suffix.lower() == ".ssp":
            root = _chosen(files.unpacked(File(place, str(given))), variant, files)
        elif given.suffix.lower() == ".ssd":
            if variant is not None:
                message = f'a single .ssd has no variants; give it without --variant "{variant}"'
                raise SystemDescriptionError([Problem(Where(str(given)), message)])
            root = File(place, str(given))
        else:
            kinds = (
                f"an .ssd, an .ssp, an .fmu, a multi-model (.json), an {OSP_DOCUMENT}, a project of MasterSim (.msim)"
            )
            message = f"is neither {kinds} nor a folder with {ROOT_DOCUMENT}"
            raise SystemDescriptionError([Problem(Where(str(given)), message)])
        return _structure(given, root, files)
    except BaseException:
        for opened in files.archives:
            opened.close()
        raise


def _shipped(name: str) -> Path:
    """Returns the folder of a shipped system.

    Raises:
        SystemDescriptionError: the system does not exist, or its FMUs cannot be built.
    """
    try:
        found = shipped.find(name)
    except (RuntimeError, ValueError, ImportError) as error:
        raise SystemDescriptionError([Problem(Where(name), f"its FMUs cannot be built: {error}")]) from None
    if found is None:
        if Path(name).suffix.lower() == ".fmu":
            text = "no such file; uav-cosim build makes FMUs of models (fmus/NAME.fmu)"
            raise SystemDescriptionError([Problem(Where(name), text)])
        message = f"no such file or folder; give an .ssd, an .ssp or a folder with {ROOT_DOCUMENT}"
        if names := shipped.names():
            message += f", or the name of a shipped system ({near(name, names)})"
        raise SystemDescriptionError([Problem(Where(name), message)])
    return found


def _chosen(folder: File, variant: str | None, files: Files) -> File:
    """Returns the root document of a folder or unpacked archive (SSP 2.0, section 3)."""
    documents = {
        path.name: File(path, f"{folder.shown}/{path.name}", folder.boundary)
        for path in sorted(folder.path.glob("*.ssd"))
        if path.is_file()
    }
    default = documents.get(ROOT_DOCUMENT, File(folder.path / ROOT_DOCUMENT, f"{folder.shown}/{ROOT_DOCUMENT}"))
    if variant is None:
        # A folder may contain .ssd files that components refer to; in an archive, only resources/ may.
        others = [name for name in documents if name != ROOT_DOCUMENT]
        if others and folder.boundary is not None:
            listed = ", ".join(others)
            files.notes.append(f"{folder.shown}: variants {listed} are left out; {ROOT_DOCUMENT} is used")
        return default
    named: dict[str, list[str]] = {}
    for name, file in documents.items():
        named.setdefault(_name_of(file), []).append(name)
    matching = named.get(variant) or [name for name in (variant, f"{variant}.ssd") if name in documents]
    if len(matching) == 1:
        return documents[matching[0]]
    where = Where(folder.shown)
    if matching:
        message = f'{" and ".join(matching)} both have the name "{variant}"; give the name of the file instead'
    else:
        message = f'there is no variant "{variant}"; {near(variant, _names(named, documents))}'
    raise SystemDescriptionError([Problem(where, message)])


def _names(named: dict[str, list[str]], documents: dict[str, File]) -> Sequence[str]:
    return [name for name in named if name] or list(documents)


def _name_of(file: File) -> str:
    """Returns the name of the description in an .ssd; empty if unreadable, which is reported when it is chosen."""
    try:
        return parsed(file).get("name", "")
    except SystemDescriptionError:
        return ""


def _instead(given: Path) -> str:
    """Returns what a folder or archive without a root document holds instead, and what to do; may be empty."""
    if (given / "manifest.json").is_file():
        return f"; {given} is the folder of a run: give the system that was run"
    if (given / "study.json").is_file():
        return f"; {given} holds a campaign: try uav-cosim report {given}"
    if str(given) in shipped.names():
        return f"; the folder {given} hides the shipped system of this name: rename it, or work in another folder"
    if others := sorted(path.name for path in given.glob("*.ssd")):
        return f"; give one of these: {', '.join(str(given / name) for name in others)}"
    if runs := sorted(path.parent.name for path in given.glob("*/manifest.json")):
        shown = ", ".join(runs[:_RUNS]) + (f" and {len(runs) - _RUNS} more" if len(runs) > _RUNS else "")
        return f"; {given} holds results of runs: {shown}"
    return ""


def _structure(given: Path, file: File, files: Files) -> SystemStructure:
    if not file.path.is_file():
        raise SystemDescriptionError([Problem(Where(file.shown), f"no such file{_instead(given)}")])
    document = Document(file, files, ((file.path.resolve(), ""),))
    root = document.root
    system = document.system()
    start, stop = document.experiment()
    document.validate()
    return SystemStructure(
        name=root.get("name", ""),
        version=root.get("version", ""),
        path=given,
        document=file.path.resolve(),
        system=system,
        where=document.reader.where(root),
        start_time=start,
        stop_time=stop,
        units=document.defined.units,
        enumerations=document.defined.enumerations,
        annotations=document.annotations(root),
        problems=tuple(dict.fromkeys(files.problems)),
        notes=tuple(dict.fromkeys(files.notes)),
        archives=tuple(files.archives),
        generation_tool=root.get("generationTool", ""),
    )
