"""Compiles the C part of isolation, or finds it: the library `isolation.so` and the program `host`.

Where memory cannot be shared with a process (macOS, Windows), they are `proxy` alone, for sockets, and `portable`.

    python -m cosim_master.fmi.isolation.building FOLDER

writes both to FOLDER/isolation-DIGEST/ for a wheel, where DIGEST is that of their sources. They are looked for in
``compiled`` of the package, then in the user's cache folder, and are compiled if they are in neither.
"""

from __future__ import annotations

import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from cosim_master.files.kept import intact, private_cache, seal

__all__ = ["HOST", "LIBRARY", "CannotIsolate", "binaries", "connecting", "portable", "shares_memory"]

LIBRARY, HOST = "isolation.so", "host"
_SOURCES = Path(__file__).parent
_FLAGS = ("-std=gnu11", "-O2", "-g0", "-fvisibility=hidden", "-Wall", "-Wextra", "-Werror")
_PORTABLE = ("-std=gnu11", "-O2", "-g0", "-Wall", "-Wextra", "-Werror")
_LIBRARIES = ("-lm", "-lpthread", "-ldl")
_STRIPPED = "-s"
"""As FMUs are linked: zig compiles its runtime library once for programs with symbols and once for those without."""
_NO_RUNTIME = "-rtlib=none"
"""Of zig: these sources need its runtime library, which takes seconds to compile, on Windows only."""


class CannotIsolate(Exception):
    """FMUs cannot have processes of their own here; the text says why."""


def shares_memory() -> bool:
    """Returns whether FMUs' processes share memory with the master here; otherwise, sockets connect them."""
    return sys.platform == "linux" and platform.machine() in ("x86_64", "aarch64")


@cache
def binaries() -> Path:
    """Returns the folder with LIBRARY and HOST.

    Raises:
        CannotIsolate: this is not Linux, or the sources have not been compiled and cannot be.
    """
    if not shares_memory():
        raise CannotIsolate(f"processes of FMUs need Linux on x86_64 or aarch64, and this is {platform.platform()}")
    name = f"isolation-{_digest()}"
    shipped = _SOURCES.parents[1] / "compiled" / name
    if os.access(shipped / HOST, os.X_OK):
        return shipped
    kept = private_cache() / "isolation" / name
    if not all(intact(kept / file) for file in (LIBRARY, HOST)):
        kept.parent.mkdir(parents=True, exist_ok=True)
        fresh = Path(tempfile.mkdtemp(dir=kept.parent, prefix="new-"))
        try:
            if (shipped / HOST).is_file():  # installed without its permission to be executed
                for file in (LIBRARY, HOST):
                    shutil.copyfile(shipped / file, fresh / file)
                    (fresh / file).chmod(0o755)
            else:
                _compile(fresh)
            for file in (LIBRARY, HOST):
                seal(fresh / file)
            kept.mkdir(exist_ok=True)
            for made in fresh.iterdir():  # one by one: other processes may use those that were there
                made.replace(kept / made.name)
        finally:
            shutil.rmtree(fresh, ignore_errors=True)
    return kept


@cache
def portable(target: str) -> Path:
    """Returns the program `portable` for a system, e.g. "x86_64-windows-gnu"; a native one needs no target.

    Raises:
        CannotIsolate: it has not been compiled and cannot be.
    """
    return _native("portable", target, ".exe" if _windows(target) else "")


@cache
def connecting(target: str, *flags: str) -> Path:
    """Returns the library of the master's side for processes that are connected by sockets only.

    Args:
        target: the system, as for `portable`.
        flags: further ones of the compiler. "-DPORTABLE" makes on Linux, too, what other systems have.

    Raises:
        CannotIsolate: it has not been compiled and cannot be.
    """
    macos = "macos" in target or (not target and sys.platform == "darwin")
    suffix = ".dll" if _windows(target) else ".dylib" if macos else ".so"
    more = ("-shared", "-fvisibility=hidden", *flags, *(() if _windows(target) else ("-fPIC",)))
    return _native("proxy", target, suffix, *more)


def _windows(target: str) -> bool:
    return "windows" in target or (not target and sys.platform == "win32")


def _native(name: str, target: str, suffix: str, *flags: str) -> Path:
    """Returns a file compiled from a source without shared memory."""
    kept = private_cache() / "isolation" / f"{name}-{_digest(' '.join((target, *flags)))}{suffix}"
    if not intact(kept):
        if find_spec("ziglang") is None:
            text = "their C part is not compiled: install uav-cosim[build], which brings a C compiler"
            raise CannotIsolate(text)
        kept.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=kept.parent, prefix="new-") as folder:
            fresh = Path(folder) / kept.name
            command = [sys.executable, "-m", "ziglang", "cc", *(["-target", target] if target else []), *_PORTABLE]
            more = ["-lws2_32"] if _windows(target) else [*_LIBRARIES, _NO_RUNTIME]
            _run([*command, _STRIPPED, *flags, str(_SOURCES / f"{name}.c"), "-o", str(fresh), *more])
            fresh.replace(kept)
        seal(kept)
    return kept


def _digest(target: str = "") -> str:
    digest = hashlib.sha256(f"{platform.machine()} {target}".strip().encode())
    for file in sorted(_SOURCES.glob("*.[ch]")):
        digest.update(file.name.encode() + file.read_bytes())
    digest.update(" ".join((*_FLAGS, _STRIPPED, *_LIBRARIES)).encode())
    return digest.hexdigest()[:16]


def _compile(folder: Path) -> None:
    if os.environ.get("CC"):
        try:
            compiler = shlex.split(os.environ["CC"])
        except ValueError:
            text = f'their C part is not compiled: the quotes of CC="{os.environ["CC"]}" do not match'
            raise CannotIsolate(text) from None
    elif find_spec("ziglang") is not None:
        zig = [sys.executable, "-m", "ziglang", "cc"]
        compiler = [*zig, "-target", f"{platform.machine()}-linux-gnu.2.17", _NO_RUNTIME]
    else:
        text = "their C part is not compiled: install uav-cosim[build], which brings a C compiler, or set CC"
        raise CannotIsolate(text)
    proxy, host, *others = (str(_SOURCES / f"{name}.c") for name in ("proxy", "host", "stack", "crash", "signals"))
    for command in (
        ["-fPIC", "-shared", proxy, host, *others, "-o", str(folder / LIBRARY), "-ldl"],
        ["-DPROGRAM", host, "-o", str(folder / HOST), *_LIBRARIES],
    ):
        _run([*compiler, *_FLAGS, _STRIPPED, *command])


def _run(command: Sequence[str]) -> None:
    """Runs the C compiler.

    Raises:
        CannotIsolate: it refuses, or there is none.
    """
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError as error:
        raise CannotIsolate(f"the C compiler {command[0]} cannot be run: {error.strerror}") from None
    if done.returncode:
        raise CannotIsolate(f"their C part does not compile:\n{done.stderr}")


def main(arguments: Sequence[str]) -> None:
    """Writes both files to the folder that `arguments` name."""
    if len(arguments) != 1:
        sys.exit("usage: python -m cosim_master.fmi.isolation.building FOLDER")
    shutil.copytree(found := binaries(), Path(arguments[0]) / found.name, dirs_exist_ok=True)


if __name__ == "__main__":
    main(sys.argv[1:])
