"""The compiled build: numba lowers the kernels to machine code, one C file makes them an FMI 2 binary.

No Python is left in the binary. The kernels are compiled for the plain instruction set of each target, so that a
binary runs on every machine of its platform and gives the same bits there.
"""

from __future__ import annotations

import json
import os
import platform
import re
import shlex
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cosim.build.description import as_text, model_description
from cosim.build.sources import Sources
from cosim.model import Model, flat_variables, record_layout

__all__ = ["HOST", "TARGETS", "CannotCompile", "build_compiled"]


class CannotCompile(Exception):
    """A kernel is outside the subset that numba lowers; the text says which, where and why."""


@dataclass(frozen=True, slots=True)
class Target:
    """A platform: its folder in an FMU, its LLVM triple and zig's name for it, the suffix of its libraries."""

    folder: str
    triple: str
    zig: str
    suffix: str


TARGETS = {
    "linux-x86_64": Target("linux64", "x86_64-unknown-linux-gnu", "x86_64-linux-gnu.2.17", ".so"),
    "linux-aarch64": Target("aarch64-linux", "aarch64-unknown-linux-gnu", "aarch64-linux-gnu.2.17", ".so"),
    "windows-x86_64": Target("win64", "x86_64-pc-windows-gnu", "x86_64-windows-gnu", ".dll"),
    "macos-aarch64": Target("aarch64-darwin", "arm64-apple-macosx11.0.0", "aarch64-macos", ".dylib"),
    "macos-x86_64": Target("darwin64", "x86_64-apple-macosx11.0.0", "x86_64-macos", ".dylib"),
}


def _host() -> str:
    machine = {"AMD64": "x86_64", "arm64": "aarch64"}.get(platform.machine(), platform.machine())
    return {"darwin": "macos", "win32": "windows"}.get(sys.platform, sys.platform) + "-" + machine


HOST = _host()


def build_compiled(
    model: type[Model], sources: Sources, stamp: dict[str, object], file: Path, targets: Sequence[str]
) -> None:
    """Write the FMU `file` with a binary for each of `targets` (keys of `TARGETS`).

    Raises:
        CannotCompile: numba cannot lower a kernel, or it needs more than the C library.
        RuntimeError: the C compiler failed; the message has its output.
    """
    assert model.kernels is not None
    guid = sources.guid(model.__name__)
    dtype, head = record_layout(model.variables)
    ir = [_lower(model, kernel, name, dtype) for kernel, name in zip(model.kernels, _SYMBOLS, strict=True)]
    binaries: dict[str, bytes] = {}
    with tempfile.TemporaryDirectory(prefix="uav-cosim-build-") as temporary:
        folder = Path(temporary)
        (folder / "model.h").write_text(_header(model, guid, dtype, head), encoding="utf-8")
        for name in targets:
            target = TARGETS[name]
            objects = [_emit(text, target, folder / f"{symbol}.o") for text, symbol in zip(ir, _SYMBOLS, strict=True)]
            library = folder / f"{model.__name__}{target.suffix}"
            _link(objects, library, name, model.__name__)
            binaries[f"binaries/{target.folder}/{library.name}"] = library.read_bytes()
    description = as_text(model_description(model, guid, compiled=True)).encode()
    entries = {
        "modelDescription.xml": description,
        "resources/build.json": json.dumps(stamp, indent=1, sort_keys=True).encode(),
        **binaries,
    }
    part = file.with_suffix(".part")
    with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
        for entry, content in entries.items():
            archive.writestr(zipfile.ZipInfo(entry, (2020, 1, 1, 0, 0, 0)), content, zipfile.ZIP_DEFLATED)
    part.replace(file)


_SYMBOLS = ("model_start", "model_advance")


def _lower(model: type[Model], kernel: Callable[..., int], symbol: str, dtype: np.dtype[np.void]) -> str:
    """LLVM IR of one kernel over a pointer to the record, entry point `symbol`."""
    from numba import carray, cfunc, from_dtype, types
    from numba.core.errors import NumbaError

    pointer = types.CPointer(from_dtype(dtype))
    if symbol == "model_start":

        def entry(p: Any) -> Any:
            return kernel(carray(p, 1)[0])

        signature = types.int32(pointer)
    else:

        def entry(p: Any, t: Any, h: Any) -> Any:
            return kernel(carray(p, 1)[0], t, h)

        signature = types.int32(pointer, types.double, types.double)
    try:
        compiled = cfunc(signature, error_model="numpy")(entry)
    except NumbaError as error:
        raise CannotCompile(f"{model.__name__}.{symbol.removeprefix('model_')}: {_first_reason(error)}") from error
    return re.sub(rf"(?<![\w.$-]){re.escape(compiled.native_name)}(?![\w.$-])", symbol, str(compiled.inspect_llvm()))


def _first_reason(error: Exception) -> str:
    """Numba's message, shortened to what and where."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    where = next((re.search(r'File "(.+)", line (\d+)', line) for line in reversed(lines) if 'File "' in line), None)
    what = next((line for line in reversed(lines) if not line.startswith(("File", "def ", "<source"))), lines[0])
    reasons = [line for line in lines if "annot" in line or "nknown" in line or "nsupported" in line or "No impl" in line]
    place = f"{where.group(1)}:{where.group(2)}: " if where else ""
    return place + (reasons[0] if reasons else what)


def _emit(ir: str, target: Target, file: Path) -> Path:
    """Machine code of `ir` for a target's plain instruction set."""
    import llvmlite.binding as llvm

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple(target.triple).create_target_machine(
        cpu="" if "x86_64" not in target.triple else "x86-64", opt=3, reloc="pic", codemodel="default"
    )
    ir = re.sub(r'^target triple = ".*"$', f'target triple = "{target.triple}"', ir, flags=re.MULTILINE)
    ir = re.sub(r'^target datalayout = ".*"$', f'target datalayout = "{machine.target_data}"', ir, flags=re.MULTILINE)
    module = llvm.parse_assembly(ir)
    module.verify()
    file.write_bytes(machine.emit_object(module))
    return file


def _link(objects: list[Path], library: Path, target: str, model: str) -> None:
    """Compile fmi2.c with model.h, link everything to a shared library that needs libc and libm only."""
    if os.environ.get("CC") and target == HOST:
        compiler = shlex.split(os.environ["CC"])
    else:
        compiler = [sys.executable, "-m", "ziglang", "cc", "-target", TARGETS[target].zig]
    source = Path(__file__).with_name("fmi2.c")
    flags = ["-std=gnu11", "-O2", "-g0", "-fvisibility=hidden", "-shared", f"-I{library.parent}"]
    if not target.startswith("windows"):
        flags += ["-fPIC", "-lm"]
    if target.startswith("linux"):
        flags += ["-Wl,--no-undefined", "-Wl,-s", "-Wl,-Bsymbolic"]
    command = [*compiler, *flags[:-1], str(source), *map(str, objects), *flags[-1:], "-lm", "-o", str(library)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        missing = sorted(set(re.findall(r"undefined (?:symbol|reference to):? [`']?([\w.$]+)", done.stderr)))
        if missing:
            raise CannotCompile(f"{model}: its kernels need {', '.join(missing)}, which only a Python process has")
        raise RuntimeError(f"{model}: {' '.join(command[:4])} ... failed:\n{done.stderr}")


def _header(model: type[Model], guid: str, dtype: np.dtype[np.void], head: int) -> str:
    """model.h: what fmi2.c has to know of one model."""
    rows: list[str] = []
    text = 0
    assert dtype.fields is not None
    for one in flat_variables(model.variables):
        v = one.variable
        kind = {"Real": "REAL", "Boolean": "BOOLEAN", "Packets": "PACKETS"}.get(v.kind, "INTEGER")
        offset = dtype.fields[v.name][1]
        if one.index is not None:
            offset += one.index * {"REAL": 8, "INTEGER": 4, "BOOLEAN": 1}[kind]
        length = dtype.fields[f"{v.name}_len"][1] if v.kind == "Packets" else 0
        low, high = v.minimum, v.maximum
        if v.enumeration:
            low, high = min(v.enumeration), max(v.enumeration)
        limits = (repr(float(low)) if low is not None else "-INFINITY", repr(float(high)) if high is not None else "INFINITY")
        role = {"parameter": "TUNABLE" if v.tunable else "FIXED", "input": "INPUT", "packet input": "INPUT"}
        rows.append(
            f'    {{"{one.name}", {kind}, {role.get(v.role, "CALCULATED")}, {offset}, {length}, {v.capacity}, {text}, '
            f"{limits[0]}, {limits[1]}}},"
        )
        if v.kind == "Packets":
            text += 4 * ((v.capacity + 2) // 3) + 1
    errors = [f"    {{{code}, {json.dumps(message)}}}," for code, message in sorted(model.errors.items())]
    defaults = ",".join(map(str, model.record().tobytes()))
    return "\n".join(
        [
            "#include <math.h>",
            f'#define MODEL "{model.__name__}"',
            f'#define GUID "{guid}"',
            f"#define RECORD_SIZE {dtype.itemsize}",
            f"#define HEAD_SIZE {head}",
            f"#define TEXT_SIZE {text}",
            f"#define N_VARIABLES {len(rows)}",
            "static const Variable VARIABLES[] = {",
            *rows,
            "};",
            f"#define N_ERRORS {len(errors)}",
            "static const KernelError ERRORS[] = {",
            *(errors or ["    {0, 0},"]),
            "};",
            f"static const unsigned char DEFAULTS[] = {{{defaults}}};",
            "",
        ]
    )
