"""The compiled build: numba compiles the kernels to machine code, and a C file turns it into an FMI 2 or 3 binary.

The binary contains no Python. Kernels are compiled for the baseline instruction set of each target, so that a binary
runs on every machine of its platform and gives the same bits there.
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
import threading
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from cosim.build.description import as_text, model_description
from cosim.build.description3 import TIME, exported, model_description3, terminals
from cosim.build.faults import faults_of, place, refusals_of
from cosim.build.native.objects import object_code
from cosim.build.sources import Sources
from cosim.kernel import compiler
from cosim.model import Model, Variable, busy_part, flat_variables, record_layout

__all__ = ["HOST", "TARGETS", "CannotCompile", "build_compiled", "kernel_code"]


class CannotCompile(Exception):
    """A kernel is outside the subset that numba compiles; the text says which one, where, and why."""


@dataclass(frozen=True, slots=True)
class Target:
    """A platform: its folder in an FMI 2 and FMI 3 FMU, LLVM triple, zig target, and suffix of shared libraries."""

    folder: str
    folder3: str
    triple: str
    zig: str
    suffix: str


TARGETS = {
    "linux-x86_64": Target("linux64", "x86_64-linux", "x86_64-unknown-linux-gnu", "x86_64-linux-gnu.2.17", ".so"),
    "linux-aarch64": Target(
        "aarch64-linux", "aarch64-linux", "aarch64-unknown-linux-gnu", "aarch64-linux-gnu.2.17", ".so"
    ),
    "windows-x86_64": Target("win64", "x86_64-windows", "x86_64-pc-windows-gnu", "x86_64-windows-gnu", ".dll"),
    "macos-aarch64": Target("aarch64-darwin", "aarch64-darwin", "arm64-apple-macosx11.0.0", "aarch64-macos", ".dylib"),
    "macos-x86_64": Target("darwin64", "x86_64-darwin", "x86_64-apple-macosx11.0.0", "x86_64-macos", ".dylib"),
}


def _host() -> str:
    machine = {"AMD64": "x86_64", "arm64": "aarch64"}.get(platform.machine(), platform.machine())
    return {"darwin": "macos", "win32": "windows"}.get(sys.platform, sys.platform) + "-" + machine


HOST = _host()


def build_compiled(
    model: type[Model],
    sources: Sources,
    stamp: Mapping[str, object],
    file: Path,
    targets: Sequence[str],
    fmi: int = 2,
    *,
    checked: bool = True,
) -> None:
    """Writes the FMU `file` with a binary for each of `targets` (keys of `TARGETS`); `fmi`: 2 or 3.

    `checked`: with checks of indices and loops (`cosim.build.native.checks`).

    Raises:
        CannotCompile: numba cannot compile a kernel, or the kernel needs more than the C library.
        RuntimeError: the C compiler failed; the message contains its output.
    """
    guid = sources.guid(model.__name__)
    described = model_description3(model, guid) if fmi == 3 else model_description(model, guid, compiled=True)
    description = as_text(described).encode()
    dtype, head = record_layout(model.variables)
    binaries: dict[str, bytes] = {}
    with tempfile.TemporaryDirectory(prefix="uav-cosim-build-") as temporary:
        folder = Path(temporary)
        described_in_c = (_model3_c if fmi == 3 else _model2_c)(model, guid, dtype, head)
        (folder / "model.c").write_text(described_in_c, encoding="utf-8")
        for name, machine_code in kernel_code(model, sources, targets, checked=checked):
            target = TARGETS[name]
            code = folder / f"{name}.o"
            code.write_bytes(machine_code)
            library = folder / f"{model.__name__}{target.suffix}"
            _link(code, library, name, model.__name__, fmi, checked)
            folder_in_fmu = target.folder3 if fmi == 3 else target.folder
            binaries[f"binaries/{folder_in_fmu}/{library.name}"] = library.read_bytes()
    entries = {
        "modelDescription.xml": description,
        "resources/build.json": json.dumps(dict(stamp), indent=1, sort_keys=True).encode(),
        **binaries,
    }
    if fmi == 3 and (grouped := terminals(model)) is not None:
        entries["terminalsAndIcons/terminalsAndIcons.xml"] = as_text(grouped).encode()
    part = file.with_suffix(f".{os.getpid()}.{threading.get_ident()}.part")
    with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
        for entry, content in sorted(entries.items()):
            archive.writestr(zipfile.ZipInfo(entry, (2020, 1, 1, 0, 0, 0)), content, zipfile.ZIP_DEFLATED)
    part.replace(file)


def kernel_code(
    model: type[Model], sources: Sources, targets: Sequence[str], *, checked: bool
) -> Iterator[tuple[str, bytes]]:
    """Yields each of `targets` with object code for it, which defines `model_start` and `model_advance` (see fmi2.c).

    Raises:
        CannotCompile: as `build_compiled`.
    """
    dtype, _ = record_layout(model.variables)
    ir = cache(lambda: _lower(model, dtype, checked))
    for name in targets:
        how = f"{name} {'checked' if checked else 'unchecked'}"
        yield name, object_code(model, sources, dtype, how, partial(_emit, ir, TARGETS[name], model))


def _lower(model: type[Model], dtype: np.dtype[np.void], checked: bool) -> str:
    """Returns LLVM IR of the two kernels as functions of a pointer to the record, `model_start` and `model_advance`.

    These are numba's own functions, without its wrappers for Python and C: ``int32 model_start(int32 *code, void
    **exception, void *record)``. They return 0, or a nonzero value if the kernel raised an exception.
    """
    from cosim.build.native.checks import checked as with_checks
    from cosim.build.native.checks import texts_of_exceptions
    from cosim.lowering import Kernel, ShortRecord, link

    numba = compiler()
    types = numba.types

    if numba.config.DISABLE_JIT:
        raise CannotCompile(
            "numba's compiler is switched off (NUMBA_DISABLE_JIT): unset it, or build with --interpreted"
        )
    assert model.kernels is not None
    start: Any
    advance: Any
    start, advance = model.kernels
    if not all(hasattr(kernel, "lower") for kernel in model.kernels):
        raise _cannot_compile(model)
    if checked:
        start, advance = with_checks(start), with_checks(advance)

    def enter_start(m: Any) -> Any:
        return start(m)

    def enter_advance(m: Any, t: Any, h: Any) -> Any:
        return advance(m, t, h)

    record = ShortRecord(dtype)
    names: dict[str, str] = {}
    libraries: list[Any] = []
    for entry, kernel, of in ((enter_start, start, ()), (enter_advance, advance, (types.float64, types.float64))):
        what = entry.__name__.removeprefix("enter_")
        plain = {"nopython": True, "error_model": "numpy", "_nrt": False}
        try:
            returned = kernel.lower((record, *of)).signature.return_type  # first, to blame the kernel
            if not isinstance(returned, types.Integer):
                raise TypeError(f"it returns {_in_words(str(returned))}; a kernel returns 0 or a key of errors")
            lowered = Kernel(entry, targetoptions=plain).lower((record, *of), types.int32)
        except Exception as error:  # numba reports some errors in a kernel as KeyError or AssertionError
            raise _cannot_compile(model, error, kernel) from error
        names[lowered.name] = f"model_{what}"
        libraries.append(lowered.library)
    if checked and (refusals := refusals_of(model)):  # to read all kernels takes a twentieth of a build
        raise CannotCompile("\n".join(f"{model.__name__}: {text}" for text in refusals))
    module = link(libraries)
    for name, known_as in names.items():
        module.get_function(name).name = known_as
    return texts_of_exceptions(str(module))


def _cannot_compile(model: type[Model], error: Exception | None = None, kernel: Any = None) -> CannotCompile:
    """Returns the error with every fault found in the sources, or numba's message if none was found."""
    recursion = "calls itself" in str(error)  # the sources give no other reason
    faults = (not recursion and faults_of(model, _returned)) or [_reason(error, kernel)]
    return CannotCompile("\n".join(f"{model.__name__}: {fault}" for fault in faults))


def _returned(kernel: Any) -> list[str]:
    """Returns what a kernel returns, in words, for each tuple of argument types for which it has been lowered."""
    from cosim.build.native.checks import checked

    if not hasattr(kernel, "lower"):
        return []
    versions: tuple[Any, ...] = (kernel, checked(kernel))
    lowered = [one for version in versions for one in version._lowered.values()]
    return [_in_words(str(one.signature.return_type)) for one in lowered]


def _place_of(kernel: Any) -> str:
    code = getattr(kernel, "py_func", kernel).__code__
    return place(code.co_filename, code.co_firstlineno)


def _reason(error: Exception | None, kernel: Any) -> str:
    """Extracts location (file:line) and cause from a numba message; the innermost cause is reported."""
    message = re.sub(r"\x1b\[[0-9;]*m", "", str(error))  # with colorama installed, numba writes in colours
    lines = [line.strip() for line in message.splitlines() if line.strip() and not line.startswith("Failed in")]
    where = _place_of(kernel)
    places = re.findall(r"(?: at |^File \")(.+\.py)(?: \(|\", line )(\d+)", message, re.MULTILINE)
    own = [(str(Path(file).resolve()), int(line)) for file, line in places if "numba" not in Path(file).parts]
    if own:
        where = place(*own[0])
    elif getattr(error, "loc", None) is not None and error.loc.filename != __file__:  # type: ignore[union-attr]
        where = place(error.loc.filename, error.loc.line)  # type: ignore[union-attr]
    if re.search("Only accept returning of array passed|NRT required", message):
        return f"{where}: it creates an array; declare a Memory in the record instead"
    text = message if type(error) is TypeError else f"{type(error).__name__}: {message}"
    text = lines[0] if type(error).__module__.startswith("numba") else text
    if used := re.search(r"^ *>>> (.+)$", message, re.MULTILINE):
        text = f"there is no {used[1]}"
    if unlike := re.search(r"Cannot unify (.+) and (.+) for '(\w+)", message):
        one, other = (_in_words(kind) for kind in unlike.group(1, 2))
        text = f"{unlike[3]} is {one} in one place and {other} in another; give it one type"
    return f"{where}: {text}" + (f" {lines[1]}" if text.endswith(":") and len(lines) > 1 else "")


def _in_words(kind: str) -> str:
    """Returns the Python name of a numba type."""
    words = {"float64": "a float", "int64": "an int", "bool": "a bool", "none": "None"}
    tuples = re.fullmatch(r"(Uni)?Tuple\(.*\)", kind)
    return "a tuple" if tuples else words.get(kind, kind)


def _emit(ir: Callable[[], str], target: Target, model: type[Model]) -> bytes:
    """Returns machine code for a target's baseline instruction set; only the two entry points are visible symbols.

    Raises:
        CannotCompile: the kernels call a function that only a Python process provides.
    """
    import llvmlite.binding as llvm

    from cosim.lowering import keep_only

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    machine = llvm.Target.from_triple(target.triple).create_target_machine(
        cpu="" if "x86_64" not in target.triple else "x86-64", opt=3, reloc="pic", codemodel="default"
    )
    module = llvm.parse_assembly(_for_target(ir(), target, machine))
    entries = ("model_start", "model_advance")
    keep_only(module, entries)
    for variable in module.global_variables:
        if not variable.is_declaration:
            variable.linkage = "internal"  # including numba's environments, which only a Python process sets
    for entry in entries:
        module.get_function(entry).visibility = "hidden"
    module.verify()
    passes = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(speed_level=3))
    passes.getModulePassManager().run(module, passes)
    called = {f.name for f in module.functions if f.is_declaration} | {
        v.name for v in module.global_variables if v.is_declaration
    }
    if missing := sorted(name for name in called if re.match("Py|_Py|NRT_|numba_", name)):
        assert model.kernels is not None
        needs = f"{_place_of(model.kernels[1])}: needs {', '.join(missing)}, which only a Python process has"
        raise CannotCompile("\n".join(f"{model.__name__}: {fault}" for fault in faults_of(model) or [needs]))
    return bytes(machine.emit_object(module))


def _for_target(ir: str, target: Target, machine: Any) -> str:
    ir = re.sub(r'^target triple = ".*"$', f'target triple = "{target.triple}"', ir, flags=re.MULTILINE)
    return re.sub(r'^target datalayout = ".*"$', f'target datalayout = "{machine.target_data}"', ir, flags=re.MULTILINE)


def _link(code: Path, library: Path, target: str, model: str, fmi: int, checked: bool) -> None:
    """Compiles fmi2.c or fmi3.c, and model.c beside `code`, and links them to a library that needs only libc and libm.

    zig keeps the object of fmi2.c or fmi3.c, which is the same for all models.
    """
    here = Path(__file__).parent
    sources = [str(here / f"fmi{fmi}.c"), str(code.with_name("model.c"))]
    libraries = ["-lm"]
    flags = ["-std=gnu11", "-O2", "-g0", "-fvisibility=hidden", "-shared", f"-I{here}", f"-DCHECKED={int(checked)}"]
    if os.environ.get("CC") and target == HOST:
        try:
            compiler = shlex.split(os.environ["CC"])
        except ValueError:
            text = f'the quotes of CC="{os.environ["CC"]}" do not match'
            raise RuntimeError(f"{model}: {text}") from None
    else:
        compiler = [sys.executable, "-m", "ziglang", "cc", "-target", TARGETS[target].zig]
        flags.append("-rtlib=none")  # zig's runtime library: no kernel calls it, and it takes seconds to compile
        if target.startswith("windows"):
            headers = Path(str(import_module("ziglang").__file__)).parent / "lib" / "libc" / "include"
            flags += ["-nostdlib", "-DWITHOUT_STARTUP", "-Wl,-e,entry_of_library"]
            flags += ["-isystem", str(headers / "any-windows-any")]
            libraries = [f"-lapi-ms-win-crt-{part}-l1-1-0" for part in ("math", "stdio", "heap", "string")]
    flags.append("-s" if target.startswith("windows") else "-fPIC")
    if target.startswith("linux"):
        flags += ["-Wl,--no-undefined", "-Wl,-s", "-Wl,-Bsymbolic"]
    command = [*compiler, *flags, *sources, str(code), *libraries, "-o", str(library)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        raise RuntimeError(f"{model}: the C compiler {compiler[0]} cannot be run: {error.strerror}") from None
    if done.returncode:
        raise RuntimeError(f"{model}: {' '.join(compiler)} failed:\n{done.stderr}")


def _model2_c(model: type[Model], guid: str, dtype: np.dtype[np.void], head: int) -> str:
    """Returns model.c for fmi2.c, with a variable for each element of an array."""
    rows: list[str] = []
    text = 0
    assert dtype.fields is not None
    for one in flat_variables(model.variables):
        v = one.variable
        kind = {"ENUMERATION": "INTEGER"}.get(_kind(v), _kind(v))
        offset = dtype.fields[v.name][1]
        if one.index is not None:
            offset += one.index * {"REAL": 8, "INTEGER": 4, "BOOLEAN": 1}[kind]
        length = dtype.fields[f"{v.name}_len"][1] if v.kind == "Packets" else 0
        rows.append(
            f'    {{"{one.name}", {kind}, {_role(v)}, {offset}, {length}, {v.capacity}, {text}, {_limits(v)}}},'
        )
        if v.kind == "Packets":
            text += 4 * ((v.capacity + 2) // 3) + 1
    together = ",".join(map(str, _together(model, dtype)))
    more = [f"const unsigned short TOGETHER[] = {{{together}}};"]
    return _model_c(model, guid, dtype, head, rows, text, more)


def _together(model: type[Model], dtype: np.dtype[np.void]) -> list[int]:
    """Returns, for each scalar variable, how many Reals from it on have the same role and limits and lie in a row."""
    assert dtype.fields is not None
    numbers: list[int] = []
    following: tuple[object, ...] | None = None
    for one in reversed(flat_variables(model.variables)):
        v = one.variable
        at = dtype.fields[v.name][1] + 8 * (one.index or 0)
        own = (_role(v), v.limits(), at) if v.kind == "Real" else None
        more = own is not None and following == (*own[:2], at + 8) and numbers[-1] < _MOST_TOGETHER
        numbers.append(0 if own is None else 1 + (numbers[-1] if more else 0))
        following = own
    return numbers[::-1]


_MOST_TOGETHER = np.iinfo(np.uint16).max


def _model3_c(model: type[Model], guid: str, dtype: np.dtype[np.void], head: int) -> str:
    """Returns model.c for fmi3.c."""
    rows: list[str] = []
    assert dtype.fields is not None
    for v in exported(model):
        length = dtype.fields[f"{v.name}_len"][1] if v.kind == "Packets" else 0
        count = v.capacity if v.kind == "Packets" else v.shape[0] if v.shape else 1
        offset = dtype.fields[v.name][1]
        rows.append(f'    {{"{v.name}", {_kind(v)}, {_role(v)}, {offset}, {length}, {count}, 0, {_limits(v)}}},')
    rows.append(f'    {{"{TIME}", TIME, INPUT, 0, 0, 1, 0, 0, 0}},')
    return _model_c(model, guid, dtype, head, rows, 0, [])


def _kind(v: Variable) -> str:
    return v.kind.upper() if v.kind in ("Real", "Integer", "Boolean", "Packets") else "ENUMERATION"


def _role(v: Variable) -> str:
    role = {"parameter": "TUNABLE" if v.tunable else "FIXED", "input": "INPUT", "packet input": "INPUT"}
    return role.get(v.role, "CALCULATED")


def _limits(v: Variable) -> str:
    return ", ".join(repr(float(x)).replace("inf", "__builtin_inf()") for x in v.limits())


def _model_c(
    model: type[Model], guid: str, dtype: np.dtype[np.void], head: int, rows: list[str], text: int, more: list[str]
) -> str:
    """Returns the definitions of what model.h declares."""
    errors = [f"    {{{code}, {json.dumps(message)}}}," for code, message in sorted(model.errors.items())]
    busy_from, busy_to = busy_part(model.variables)
    return "\n".join(
        [
            '#include "model.h"',
            f'const char MODEL[] = "{model.__name__}", GUID[37] = "{guid}";',
            f"const size_t RECORD_SIZE = {dtype.itemsize}, HEAD_SIZE = {head};",
            f"const size_t BUSY_FROM = {busy_from}, BUSY_TO = {busy_to}, TEXT_SIZE = {text};",
            f"const unsigned N_VARIABLES = {len(rows)}, N_ERRORS = {len(errors)};",
            "const Variable VARIABLES[] = {",
            *rows,
            "};",
            *more,
            f"const unsigned char DEFAULTS[] = {{{','.join(map(str, model.record().tobytes()))}}};",
            "const KernelError ERRORS[] = {",
            *(errors or ["    {0, 0},"]),
            "};",
            f'const char ERROR_CODES[] = "{", ".join(map(str, sorted(model.errors))) or "it has none"}";',
            "",
        ]
    )
