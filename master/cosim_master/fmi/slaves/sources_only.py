"""FMUs with sources and without a binary for this platform: compiled by the ziglang wheel, and cached by their digest.

`source_files` lists the files and has refused those outside of the FMU. The headers of FMI come from FMPy.
Compiling executes nothing of the FMU; running it does.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from importlib.metadata import distribution
from pathlib import Path

from cosim_master.diagnostics.errors import FmuError
from cosim_master.files.kept import intact, private_cache, seal
from cosim_master.fmi.description.read import FmuDescription

__all__ = ["compiled"]

_UNPREFIXED = ("FMI2_OVERRIDE_FUNCTION_PREFIX", "FMI3_OVERRIDE_FUNCTION_PREFIX", "DISABLE_PREFIX")
"""Functions have plain names, without a prefix, as in a binary."""
_LOG_LINES = 40
_MICROSOFT = {
    "_strdup": "strdup",
    "_stricmp": "strcasecmp",
    "_strnicmp": "strncasecmp",
    "_snprintf": "snprintf",
    "_vsnprintf": "vsnprintf",
}
"""Functions with names that only Microsoft's C library uses, and their names elsewhere."""


def compiled(fmu: FmuDescription, folder: Path) -> Path:
    """Returns the library of an FMU that is unpacked in a folder, and compiles it if it is not in the cache.

    Raises:
        FmuError: the sources do not compile; the error contains the compiler's messages.
    """
    kept = private_cache() / "sources" / f"{fmu.digest[:24]}-{fmu.model_identifier}.so"
    if intact(kept):
        return kept
    kept.parent.mkdir(parents=True, exist_ok=True)
    sources, build = folder / "sources", fmu.source_files
    if build is None:
        raise ValueError(f"{fmu.path} is not compiled from its sources")
    files = [f"./{name}" for name in build.files]
    headers = Path(str(distribution("fmpy").locate_file("fmpy/c-code")))
    common = [f"-D{name}" for name in _UNPREFIXED] + [f"-DFMI_VERSION={fmu.fmi_version[0]}", "-O2", "-fPIC", "-w"]
    handle, name = tempfile.mkstemp(dir=kept.parent, suffix=".so")
    os.close(handle)
    fresh = Path(name)
    tool = [sys.executable, "-m", "ziglang", "c++" if build.is_cpp else "cc"]
    places = [f"-I{sources}", f"-I{headers}"]
    command = [*tool, *common, *build.flags, "-shared", *places, *files, *build.libraries, "-lm", "-o", str(fresh)]
    done = subprocess.run(command, cwd=sources, capture_output=True, text=True)
    unknown = {*re.findall(r"undeclared (?:library )?function '(\w+)'", done.stderr)} & {*_MICROSOFT}
    if done.returncode and unknown:
        command += [f"-D{name}={_MICROSOFT[name]}" for name in sorted(unknown)]
        done = subprocess.run(command, cwd=sources, capture_output=True, text=True)
    if done.returncode:
        fresh.unlink(missing_ok=True)
        lines = done.stderr.strip().splitlines()[:_LOG_LINES]
        raise FmuError(fmu.model_name, "compiling its sources", f"{', '.join(files)}: the compiler refused", log=lines)
    fresh.replace(kept)
    seal(kept)
    return kept
