"""FMUs that bring sources and no binary for this platform: compiled by the ziglang wheel, and kept by their digest.

The files are those of sources/buildDescription.xml (FMI 3.0.2, 2.5.1.4, and FMI 2.0.4 on), or the SourceFiles of an
FMI 2 interface. The headers of FMI come from FMPy. Compiling executes nothing of the FMU; running it does.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from importlib.metadata import distribution
from pathlib import Path

from lxml import etree

from cosim.kernel import cache_folder
from cosim_master.document import parse
from cosim_master.errors import FmuError
from cosim_master.fmu import FmuDescription

__all__ = ["compiled"]

_UNPREFIXED = ("FMI2_OVERRIDE_FUNCTION_PREFIX", "FMI3_OVERRIDE_FUNCTION_PREFIX", "DISABLE_PREFIX")
"""Functions are called by their names alone, as in a binary."""
_LOG_LINES = 40


def compiled(fmu: FmuDescription, folder: Path) -> Path:
    """The library of an FMU that is unpacked in a folder, compiled now if it is not kept yet.

    Raises:
        FmuError: the sources do not compile; has what the compiler says.
    """
    kept = cache_folder() / "sources" / f"{fmu.digest[:24]}-{fmu.model_identifier}.so"
    if kept.is_file():
        return kept
    kept.parent.mkdir(parents=True, exist_ok=True)
    sources = folder / "sources"
    files, flags = _listed(fmu, folder)
    headers = Path(str(distribution("fmpy").locate_file("fmpy/c-code")))
    common = [f"-D{name}" for name in _UNPREFIXED] + [f"-DFMI_VERSION={fmu.fmi_version[0]}", "-O2", "-fPIC", "-w"]
    handle, name = tempfile.mkstemp(dir=kept.parent, suffix=".so")
    os.close(handle)
    fresh = Path(name)
    tool = [sys.executable, "-m", "ziglang", "c++" if any(f.endswith((".cpp", ".cc")) for f in files) else "cc"]
    command = [*tool, *common, *flags, "-shared", f"-I{sources}", f"-I{headers}", *files, "-lm", "-o", str(fresh)]
    done = subprocess.run(command, cwd=sources, capture_output=True, text=True)
    if done.returncode:
        fresh.unlink(missing_ok=True)
        lines = done.stderr.strip().splitlines()[:_LOG_LINES]
        raise FmuError(fmu.model_name, "compiling its sources", f"{', '.join(files)}: the compiler refused", log=lines)
    fresh.replace(kept)
    return kept


def _listed(fmu: FmuDescription, folder: Path) -> tuple[list[str], list[str]]:
    """The files to be compiled, as paths below sources/, and the compiler's flags."""
    description = folder / "sources" / "buildDescription.xml"
    if description.is_file():
        root = parse(description.read_bytes(), f"{fmu.path}/sources/buildDescription.xml")
        found = [
            one for one in root.iterfind("BuildConfiguration") if one.get("modelIdentifier") == fmu.model_identifier
        ]
        if found:
            return _configured(found[0])
    root = parse((folder / "modelDescription.xml").read_bytes(), f"{fmu.path}/modelDescription.xml")
    interface = "CoSimulation" if fmu.model_exchange is None else "ModelExchange"
    files = [one.get("name", "") for one in root.iterfind(f"{interface}/SourceFiles/File")]
    if not files:
        text = f"neither buildDescription.xml nor <{interface}> says which files belong to {fmu.model_identifier}"
        raise FmuError(fmu.model_name, "compiling its sources", text)
    return [f"./{name}" for name in files], []


def _configured(configuration: etree._Element) -> tuple[list[str], list[str]]:
    files = [f"./{one.get('name', '')}" for one in configuration.iterfind("SourceFileSet/SourceFile")]
    flags = []
    for one in configuration.iter("PreprocessorDefinition"):
        if one.get("optional") not in ("true", "1"):
            value = one.get("value")
            flags.append(f"-D{one.get('name')}" if value is None else f"-D{one.get('name')}={value}")
    flags += [f"-I./{one.get('name', '')}" for one in configuration.iter("IncludeDirectory")]
    for library in configuration.iterfind("Library"):
        if library.get("external") in ("true", "1"):
            flags.append(f"-l{library.get('name', '').removesuffix('.lib')}")
    return files, flags
