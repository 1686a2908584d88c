"""Kernels that Python calls through an address, in machine code that is loaded without numba.

A run calls a handful of kernels, such as the stepping loop, with tables that stay the same during the run. Their code
is kept in files (`cosim.kernel`). LLVM alone loads it, which takes a tenth of the time that numba takes to be imported,
and the addresses of the tables are collected once, not at each call.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from operator import index
from pathlib import Path
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np

from cosim.kept import made_once, read_kept, write_kept
from cosim.kernel import PLAIN, Kernel, compiler, processor, used_code

__all__ = ["Entry", "entry", "forget_tables", "signature_of"]

F = TypeVar("F", bound=Callable[..., Any])

_WORD = ctypes.c_int64
_FUNCTION = ctypes.CFUNCTYPE(ctypes.c_int32, ctypes.POINTER(_WORD), ctypes.POINTER(_WORD))
_CHECKS_INDICES = os.environ.get("NUMBA_BOUNDSCHECK", "").strip() not in ("", "0")
"""Errors of indices are exceptions, which numba makes."""


def entry(function: F) -> F:
    """Marks a kernel (`cosim.kernel.kernel`) that Python calls, too.

    Its arguments are integers, arrays, and tuples of arrays and integers; it returns an integer, a bool or nothing. A
    tuple is taken to name the same memory whenever it is passed: its arrays are not resized.
    """
    return function if PLAIN else cast(F, Entry(function))


class Entry(Kernel):
    """A kernel that is called without numba where its machine code is kept."""

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._calls: dict[str, Callable[[Any], Any]] = {}

    def __call__(self, *arguments: Any) -> Any:
        if _CHECKS_INDICES:
            return self.compiled(*arguments)
        signature, words, _memory = _laid_out(arguments)  # the last is what the words name
        call = self._calls.get(signature) or self.prepare(*arguments)
        return call(words)

    def prepare(self, *arguments: Any) -> Callable[[Any], Any]:
        """Loads the code for arguments of these types, or compiles it and keeps it; returns the function to call."""
        signature, *_ = _laid_out(arguments)
        kind, code = self._code(signature, arguments)
        call = self._calls[signature] = _loaded(self.py_func.__qualname__, kind, code)
        return call

    def _code(self, signature: str, arguments: Sequence[Any]) -> tuple[str, bytes]:
        folders = self.folders() if self.folders is not None else ()
        name = self._name(signature)
        if (found := _kept(folders, name)) is not None:
            return found
        if not folders:
            kind, code, _ = self._made(arguments)
            return kind, code
        with made_once(folders[-1] / name):
            if (found := _kept(folders, name)) is not None:
                return found
            kind, code, settled = self._made(arguments)
            if settled:
                with suppress(OSError):  # disk full, or home not writable: the next process compiles it again
                    write_kept(folders[-1] / name, kind.encode() + b"\n" + code)
                    used_code[folders[-1] / name] = None
            return kind, code

    def _made(self, arguments: Sequence[Any]) -> tuple[str, bytes, bool]:
        compiler()
        from cosim.entry_code import entry_code

        plain = [one if isinstance(one, tuple | np.ndarray) else index(one) for one in arguments]
        return entry_code(self.compiled, plain, _symbol(self.py_func.__qualname__))

    def _name(self, signature: str) -> str:
        what = repr((self.py_func.__code__.co_firstlineno, signature, _tools()))
        return f"{self.py_func.__qualname__}-{hashlib.sha256(what.encode()).hexdigest()[:24]}.kernel"


def _symbol(name: str) -> str:
    return "entry_of_" + re.sub(r"\W", "_", name)


def _kept(folders: Sequence[Path], name: str) -> tuple[str, bytes] | None:
    for folder in folders:
        if (content := read_kept(folder / name)) is not None:
            used_code[folder / name] = None
            kind, _, code = content.partition(b"\n")
            return kind.decode(), code
    return None


@cache
def _tools() -> tuple[Any, ...]:
    """Returns all that machine code depends on besides the sources and the types: tools, options and processor."""
    import llvmlite
    import llvmlite.binding as llvm

    spec = find_spec("numba")
    assert spec is not None and spec.origin is not None
    numba = Path(spec.origin).with_name("_version.py").read_text(encoding="utf-8")
    options = {name: value for name, value in sorted(os.environ.items()) if name.startswith("NUMBA_OPT")}
    target = processor() or (
        os.environ.get("NUMBA_CPU_NAME"),
        os.environ.get("NUMBA_CPU_FEATURES"),
        llvm.get_host_cpu_name(),
        llvm.get_host_cpu_features().flatten(),
    )
    return numba, llvmlite.__version__, llvm.get_process_triple(), target, options


_engines: list[Any] = []
"""What has loaded code; the code exists as long as they do."""


def _loaded(name: str, kind: str, code: bytes) -> Callable[[Any], Any]:
    """Returns a function of the words of the arguments, which calls the machine code."""
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    module = llvm.parse_assembly("")
    machine = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(codemodel="jitdefault")
    engine = llvm.create_mcjit_compiler(module, machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _engines.append(engine)
    function = _FUNCTION(engine.get_function_address(_symbol(name)))

    def call(words: Any) -> Any:
        result = _WORD()
        if function(result, words):
            raise RuntimeError(f"{name} raised an exception")
        return result.value

    def truth(words: Any) -> bool:
        return bool(call(words))

    def nothing(words: Any) -> None:
        call(words)

    return {"int": call, "bool": truth, "none": nothing}[kind]


# ---- arguments -------------------------------------------------------------------------------------------------------


class _Table(NamedTuple):
    """A tuple, the text of its types, and the words of its members."""

    value: tuple[Any, ...]
    signature: str
    words: Any
    address: int


_tables: dict[int, _Table] = {}
_MOST_TABLES = 32
"""Parts of a run that are threads of one process have three each: a plan, a radio and frames."""


def forget_tables() -> None:
    """Releases the tuples of earlier calls, and with them their arrays."""
    _tables.clear()


def signature_of(arguments: Sequence[Any]) -> str:
    """Returns a text that is the same for arguments of the same types."""
    return _laid_out(arguments)[0]


def _laid_out(arguments: Sequence[Any]) -> tuple[str, Any, list[Any]]:
    """Returns the types of arguments as a text, their words, and the memory that the words name.

    Raises:
        TypeError: an argument is neither an integer nor an array nor a tuple of these.
    """
    words = (_WORD * len(arguments))()
    signatures: list[str] = []
    memory: list[Any] = []
    for place, one in enumerate(arguments):
        if isinstance(one, tuple):
            table = _tables.get(id(one))
            if table is None:
                table = _table(one)
            signatures.append(table.signature)
            words[place] = table.address
            memory.append(table)
        elif isinstance(one, np.ndarray):
            signature, own = _of_array(one)
            signatures.append(signature)
            further = (_WORD * len(own))(*own)
            words[place] = ctypes.addressof(further)
            memory.append(further)
        else:
            signatures.append("int")
            words[place] = index(one)
    return " ".join(signatures), words, memory


def _table(value: tuple[Any, ...]) -> _Table:
    """Returns the words of a tuple, which is kept until `forget_tables`: no other has its identity meanwhile."""
    signatures: list[str] = []
    numbers: list[int] = []
    _add(value, signatures, numbers)
    words = (_WORD * max(len(numbers), 1))(*numbers)
    digest = hashlib.sha256(" ".join(signatures).encode()).hexdigest()[:16]
    if len(_tables) >= _MOST_TABLES:
        _tables.clear()
    made = _Table(value, f"{type(value).__name__}:{digest}", words, ctypes.addressof(words))
    _tables[id(value)] = made
    return made


def _add(value: Any, signatures: list[str], numbers: list[int]) -> None:
    if isinstance(value, tuple):
        signatures.append(f"({type(value).__name__} {getattr(value, '_fields', '')}")
        for one in value:
            _add(one, signatures, numbers)
        signatures.append(")")
    elif isinstance(value, np.ndarray):
        signature, words = _of_array(value)
        signatures.append(signature)
        numbers += words
    else:
        signatures.append("int")
        numbers.append(index(value))


def _of_array(array: np.ndarray[Any, Any]) -> tuple[str, list[int]]:
    flags = array.flags
    layout = "C" if flags.c_contiguous else "F" if flags.f_contiguous else "A"
    access = ("" if flags.writeable else " read only") + ("" if flags.aligned else " unaligned")
    signature = f"{_named(array.dtype)}[{array.ndim}]{layout}{access}"
    return signature, [array.ctypes.data, *array.shape, *array.strides]


_names: dict[int, tuple[np.dtype[Any], str]] = {}


def _named(dtype: np.dtype[Any]) -> str:
    if dtype.fields is None:
        return dtype.str
    known = _names.get(id(dtype))
    if known is None:
        known = _names[id(dtype)] = dtype, hashlib.sha256(repr(dtype).encode()).hexdigest()[:16]
    return known[1]
