"""Compilation of kernels: numba lowers each function to LLVM IR once, and LLVM optimises all of them together.

On its own, numba compiles a function completely before it compiles the caller. It optimises the function together with
copies of all its callees, generates machine code and a Python wrapper, and caches both. This is repeated at each level
of calls, although Python calls only a few of the hundreds of kernels.

Here, a kernel that another kernel calls is only lowered. Machine code is generated on demand, when Python calls a
kernel or a model is built: the IR of the kernel and of all its callees is linked into one module, every symbol except
the entry point becomes internal, and the module is optimised and emitted once.

The IR of kernels in packages is stored in files, too. Whoever builds a model of their own lowers their own functions
and finds those of this project, which are most.

This module uses numba's internals (`numba.core`): its dispatcher, its target and its code library. So do `shortcuts`,
which this module puts to use, and the checks of `cosim.build.native.checks`.
"""

from __future__ import annotations

import gc
import hashlib
import io
import pickle
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from functools import cache, cached_property
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding as llvm
import numpy as np
from llvmlite import __version__ as llvmlite_version
from llvmlite import ir as llvm_ir
from numba import __version__ as numba_version
from numba import from_dtype
from numba.core import cgutils, compiler, config, errors, event, types, typing
from numba.core.caching import _Cache
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen
from numba.core.compiler_lock import global_compiler_lock
from numba.core.datamodel import register_default
from numba.core.datamodel.models import RecordModel
from numba.core.dispatcher import _FunctionCompiler
from numba.core.environment import Environment, lookup_environment
from numba.core.funcdesc import PythonFunctionDescriptor, default_mangler, qualifying_prefix
from numba.core.registry import CPUDispatcher, CPUTarget, cpu_target
from numba.core.serialize import dumps
from numba.core.sigutils import normalize_signature
from numba.np import arrayobj

from cosim import folding, shortcuts
from cosim.deferred import on_compilation
from cosim.kept import made_once, read_kept, write_kept

__all__ = ["Kernel", "Library", "Lowered", "ShortRecord", "keep_only", "link", "without_collector"]

_ENVIRONMENT = "_ZN08NumbaEnv"
_config: Any = config  # whose names are made as it is read


class Lowered(NamedTuple):
    """A lowered kernel for one tuple of argument types: its signature and its LLVM IR."""

    result: Any
    library: Library

    @property
    def signature(self) -> Any:
        return self.result.signature

    @property
    def name(self) -> str:
        """Symbol of the function in the module: ``int32 name(result *, void **exception, arguments...)``."""
        return str(self.result.fndesc.llvm_func_name)


class Library(JITCodeLibrary):  # type: ignore[misc]
    """The IR of one function and the libraries of its callees; machine code is generated on demand."""

    is_of_kernel = False
    file: Path | None = None
    """Where the IR of this kernel is stored; None: nowhere, so that of its callers is not stored either."""

    def add_ir_module(self, ir_module: Any) -> None:
        self._raise_if_finalized()
        folding.sweep(ir_module)
        text = cgutils.normalize_ir_text(str(ir_module))
        module = llvm.parse_assembly(text)
        for name in ir_module.globals:
            if name.startswith(_ENVIRONMENT) and text.count(name) == 1:  # declared but never used
                module.get_global_variable(name).linkage = "internal"
        self._final_module.link_in(module)

    def add_linking_library(self, library: Any) -> None:
        self._linking_libraries.append(library)

    def finalize(self) -> None:
        self._raise_if_finalized()
        module = link([self])
        keep_only(module, {f.name for f in self._final_module.functions if not f.is_declaration})
        passes, builder = self._codegen._module_pass_manager()
        passes.run(module, builder)
        module.verify()
        self._final_module = module
        self._finalize_final_module()
        for variable in module.global_variables:
            if variable.name.startswith(_ENVIRONMENT) and (found := lookup_environment(variable.name)) is not None:
                self._codegen.set_env(variable.name, found)

    def _get_module_for_linking(self) -> Any:
        """Returns the module for a function that numba compiles by its own pipeline."""
        if self._shared_module is None:
            self._shared_module = link([self])
            for function in self._shared_module.functions:
                if not function.is_declaration and function.linkage == llvm.Linkage.external:
                    function.linkage = "linkonce_odr"
        return self._shared_module

    def serialize_using_object_code(self) -> tuple[str, str, tuple[bytes, list[str]]]:
        self._ensure_finalized()
        defined = (f for f in self._final_module.functions if not f.is_declaration)
        external = [f.name for f in defined if f.linkage == llvm.Linkage.external]
        return self.name, "kernel", (self._get_compiled_object(), external)

    @classmethod
    def _unserialize(cls, codegen: Any, state: tuple[str, str, tuple[bytes, list[str]]]) -> Library:
        name, _, (code, external) = state
        self = cls(codegen, name)
        self.enable_object_caching()
        self._set_compiled_object(code)
        self._finalize_final_module()
        codegen._engine._defined_symbols.update(external)
        return self


class ShortRecord(types.Record):  # type: ignore[misc]
    """A record type named by the digest of its fields; numba's own name lists all fields and is printed very often."""

    def __init__(self, dtype: np.dtype[np.void]) -> None:
        plain: Any = from_dtype(dtype)
        self.fields, self.size, self.aligned, self.bitwidth = plain.fields, plain.size, plain.aligned, plain.bitwidth
        types.Type.__init__(self, f"record<{hashlib.sha256(plain.name.encode()).hexdigest()[:12]}>")

    def __repr__(self) -> str:
        return str(self.name)


register_default(ShortRecord)(RecordModel)


def link(libraries: Sequence[Any]) -> Any:
    """Returns a new module with the functions of `libraries` and all their callees, direct or indirect.

    LLVM needs time in proportion to the size of the module that it links another one into, so modules are linked in
    pairs, pairs of pairs, and so on. The functions are then put into the order of `libraries` and their callees,
    because LLVM's decisions on inlining depend on it.
    """
    found: dict[Any, None] = {}
    waiting = list(reversed(libraries))
    while waiting:
        one = waiting.pop()
        if one not in found:
            found[one] = None
            if isinstance(one, Library):
                waiting += reversed(one._linking_libraries)
    every = [one._final_module if isinstance(one, Library) else one._get_module_for_linking() for one in found]
    modules = [module.clone() for module in every]
    places: dict[str, int] = {}
    for function in (function for module in modules for function in module.functions):
        if not function.is_declaration:
            places.setdefault(function.name, len(places))
            if function.linkage == llvm.Linkage.linkonce_odr:
                function.linkage = "weak_odr"  # also kept where the caller is in another pair
    while len(modules) > 1:
        for one, other in zip(modules[::2], modules[1::2], strict=False):
            one.link_in(other)
        modules = modules[::2]
    module = _in_order(modules[0], places)
    written = next(iter(found))._codegen.written
    missing = {f.name: written[f.name] for f in module.functions if f.is_declaration and f.name in written}
    if known := [name for name, library in missing.items() if library in found]:
        raise RuntimeError(f"the code of {known[0]} does not define it")
    return link([*libraries, *missing.values()]) if missing else module


_FUNCTION = re.compile(r"^define .*?^\}$", re.MULTILINE | re.DOTALL)
_NUMBER = re.compile(r"\.[0-9]+$")


def _in_order(module: Any, places: Mapping[str, int]) -> Any:
    """Returns a module with its functions in the order of `places`; LLVM numbers internal ones of the same name."""
    names = [function.name for function in module.functions if not function.is_declaration]
    order = [places[name] if name in places else places[_NUMBER.sub("", name)] for name in names]
    if order == sorted(order):
        return module
    text = str(module)
    functions = _FUNCTION.findall(text)
    following = iter([function for _, function in sorted(zip(order, functions, strict=True), key=itemgetter(0))])
    return llvm.parse_assembly(_FUNCTION.sub(lambda _: next(following), text))


def keep_only(module: Any, names: Iterable[str]) -> None:
    """Makes every definition in `module` except `names` internal, so that LLVM may remove or change it."""
    kept = set(names)
    for value in (*module.functions, *module.global_variables):
        if not value.is_declaration and value.name not in kept and value.linkage != llvm.Linkage.common:
            value.linkage = "internal"


class _Unsettled(Exception):
    """The IR of a kernel depends on this process."""


_settled: dict[str, Library] = {}
"""Libraries that are complete in their files, by place. They stay when a file disappears, or the folder of all digests
is another one: two libraries of a kernel could not be linked."""


class _Description(NamedTuple):
    """What callers of a lowered kernel have to know besides the types of its arguments."""

    returns: Any
    arguments: tuple[str, ...]
    inline: bool
    noalias: bool
    abi_tags: tuple[Any, ...]


class _Stored:
    """The IR of one kernel for one tuple of argument types, in a file or to be written to one.

    The IR is brought into a form that does not depend on the process: the kernel's symbol is named by the digest that
    names the file, and small functions of numba, such as `min` of two numbers, become internal. Kernels have this form
    whether they are read or have just been lowered, so that the same machine code is made of both.
    """

    def __init__(self, function: Any, types: tuple[Any, ...], file: Path, digest: str) -> None:
        self._function, self._types, self._file = function, types, file
        name = qualifying_prefix(function.__module__, function.__qualname__)
        self._symbol = default_mangler(name, (), uid=digest)  # numba names types by numbers of this process

    def read(self, context: Any) -> Lowered | None:
        """Returns the kernel, with the libraries of its callees; None if a file is missing."""
        found = _read(context.codegen(), self._file)
        if found is None:
            return None
        library, description = found
        return self._lowered(context, library, _Unpickler(io.BytesIO(description), self._types).load())

    def write(self, lowered: Lowered) -> Lowered:
        """Stores a kernel that has just been lowered, and returns it as `read` does.

        Raises:
            _Unsettled: the IR depends on this process, or on a kernel whose IR does.
        """
        fndesc, context = lowered.result.fndesc, lowered.result.target_context
        if tuple(fndesc.argtypes) != self._types:
            raise _Unsettled
        module, callees = self._module(lowered)
        restype = lowered.signature.return_type
        description = _Description(restype, tuple(fndesc.args), fndesc.inline, fndesc.noalias, tuple(fndesc.abi_tags))
        described = io.BytesIO()
        _Pickler(described, self._types).dump(description)
        content = [_place(callee.file) for callee in callees], described.getvalue(), module.as_bitcode()
        with suppress(OSError):  # disk full, or home not writable: the next process lowers it again
            write_kept(self._file, pickle.dumps(content))
        return self._lowered(context, _library(context.codegen(), self._file, module, callees), description)

    def _module(self, lowered: Lowered) -> tuple[Any, list[Library]]:
        """Returns a module with the kernel and the functions of numba that it calls, and the kernels that it calls."""
        parts, callees = _parts(lowered.library)
        if any(callee.file is None for callee in callees):
            raise _Unsettled
        module = parts[0]._final_module.clone()
        for part in parts[1:]:
            module.link_in(
                (part._final_module if isinstance(part, Library) else part._get_module_for_linking()).clone()
            )
        for one in module.global_variables:
            if one.name.startswith(".dynamic.globals"):  # an address in this process
                raise _Unsettled
            if one.name.startswith(_ENVIRONMENT):
                if str(module).count(one.name) > 1:  # a Python object in this process
                    raise _Unsettled
                one.linkage = "internal"
        known = {function.name for callee in callees for function in callee._final_module.functions}
        inner = 0
        for function in module.functions:
            if function.is_declaration:
                if function.name.startswith("_ZN") and function.name not in known:  # a caller of this kernel
                    raise _Unsettled
            elif function.name == lowered.name:
                function.name = self._symbol
            else:
                inner += 1
                function.name = f"{self._symbol}.{inner}"
        keep_only(module, [self._symbol])
        return module, callees

    def _lowered(self, context: Any, library: Library, description: _Description) -> Lowered:
        function, returns = self._function, description.returns
        fndesc = PythonFunctionDescriptor(
            True,
            function.__module__,
            function.__qualname__,
            function.__qualname__,
            "",
            None,
            returns,
            None,
            description.arguments,
            (),
            argtypes=self._types,
            inline=description.inline,
            noalias=description.noalias,
            abi_tags=description.abi_tags,
        )
        fndesc.mangled_name = self._symbol
        fndesc.env_name = f"{_ENVIRONMENT}{self._symbol}"
        result = compiler.CompileResult(
            typing_context=None,
            target_context=context,
            entry_point=None,
            typing_error=None,
            type_annotation="",
            signature=typing.signature(returns, *self._types),
            objectmode=False,
            lifted=(),
            fndesc=fndesc,
            library=library,
            call_helper=None,
            environment=Environment.from_fndesc(fndesc),
            metadata={},
            reload_init=[],
            referenced_envs=(),
        )
        return Lowered(result, library)


def _parts(library: Library) -> tuple[list[Any], list[Library]]:
    """Returns the library and those of numba that it needs, and those of kernels that these call."""
    parts: list[Any] = []
    callees: dict[Library, None] = {}
    waiting: list[Any] = [library]
    while waiting:
        one = waiting.pop()
        if one is not library and isinstance(one, Library) and one.is_of_kernel:
            callees.setdefault(one)
        elif one not in parts and one.name != "nrt":  # kernels count no references
            parts.append(one)
            waiting += reversed(one._linking_libraries)
    return parts, list(callees)


def _place(file: Path | None) -> str:
    """Returns the file's path within the folder of all digests."""
    assert file is not None
    return f"{file.parent.name}/{file.name}"


def _library(codegen: Any, file: Path, module: Any, callees: Sequence[Library]) -> Library:
    if (known := _settled.get(_place(file))) is not None:
        return known
    library = Library(codegen, file.stem)
    library._final_module = module
    library._linking_libraries = list(callees)
    library.is_of_kernel, library.file = True, file
    _settled[_place(file)] = library
    return library


def _read(codegen: Any, file: Path) -> tuple[Library, bytes] | None:
    """Returns the library of a file, which links those of its callees, and the description of the kernel."""
    if (code := read_kept(file)) is None:
        return None
    places, description, bitcode = pickle.loads(code)
    if (library := _settled.get(_place(file))) is not None:
        return library, description
    callees = []
    for place in places:
        if (known := _settled.get(place)) is None:
            if (found := _read(codegen, file.parent.parent / place)) is None:
                return None
            known = found[0]
        callees.append(known)
    return _library(codegen, file, llvm.parse_bitcode(bitcode), callees), description


class _Pickler(pickle.Pickler):
    """Pickles types; those of arguments by number, because records are long and the caller has them."""

    def __init__(self, file: Any, types: tuple[Any, ...]) -> None:
        super().__init__(file, pickle.HIGHEST_PROTOCOL)
        self._places = {id(one): place for place, one in enumerate(types)}

    def persistent_id(self, value: Any) -> int | None:
        return self._places.get(id(value))


class _Unpickler(pickle.Unpickler):
    def __init__(self, file: Any, types: tuple[Any, ...]) -> None:
        super().__init__(file)
        self._types = types

    def persistent_load(self, place: int) -> Any:
        return self._types[place]


class _KeptCode(_Cache):  # type: ignore[misc]
    """Stores machine code of one kernel in files, one per tuple of argument types, processor and Python version.

    File names do not depend on the machine that wrote them, so several checkouts can share a folder and a package can
    contain one.
    """

    def __init__(self, function: Any, find_folders: Callable[[], Sequence[Path]]) -> None:
        self._function, self._find_folders = function, find_folders

    @cached_property
    def _folders(self) -> Sequence[Path]:
        """The folders of this kernel: digests of sources are computed for kernels that Python calls only."""
        return self._find_folders()

    @property
    def cache_path(self) -> str:
        return str(self._folders[-1])

    def _name(self, signature: Any, context: Any) -> str:
        code = self._function.__code__
        tools = (numba_version, llvmlite_version, sys.version_info[:2], context.codegen().magic_tuple())
        level = int(_config.OPT)  # NUMBA_OPT, for debugging
        what = repr((str(signature), code.co_firstlineno, tools, level))
        return f"{self._function.__qualname__}-{hashlib.sha256(what.encode()).hexdigest()[:24]}.kernel"

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        name = self._name(sig, target_context)
        for folder in self._folders:
            if (code := read_kept(folder / name)) is not None:
                return compiler.CompileResult._rebuild(target_context, *pickle.loads(code))
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        if data.library.has_dynamic_globals:
            return
        file = self._folders[-1] / self._name(sig, data.target_context)
        try:
            write_kept(file, dumps(data._reduce()))
        except OSError:  # disk full, or home not writable: the next process compiles it again
            return

    def made_once(self, signature: Any, context: Any) -> AbstractContextManager[None]:
        """Lets one process compile code that is missing, such as one of the parts of a run that start together."""
        name = self._name(signature, context)
        if any((folder / name).is_file() for folder in self._folders):
            return nullcontext()
        return made_once(self._folders[-1] / name)

    def flush(self) -> None:
        for file in self._folders[-1].glob(f"{self._function.__qualname__}-*.kernel"):
            file.unlink(missing_ok=True)

    def enable(self) -> None:
        """Does nothing: the cache is always enabled."""

    def disable(self) -> None:
        raise NotImplementedError("kernel code is always cached")


class _Codegen(JITCPUCodegen):  # type: ignore[misc]
    _library_class = Library

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.written: dict[str, Library] = {}
        """Functions by name, for callers that were lowered before the function was complete."""

    def insert_unresolved_ref(self, builder: Any, function_type: Any, name: str) -> Any:
        """Declares a kernel that calls one of its callers; both are in the final module."""
        return cgutils.get_or_insert_function(builder.module, function_type, name)


class _Target(CPUTarget):  # type: ignore[misc]
    """numba's CPU target with the code generator of this module."""

    @cached_property
    def _context(self) -> Any:
        return cpu_target.target_context.subtarget(_internal_codegen=_Codegen("cosim.kernels"))

    @property
    def target_context(self) -> Any:
        return self._context

    @property
    def typing_context(self) -> Any:
        return cpu_target.typing_context


@contextmanager
def without_collector() -> Iterator[None]:
    """Suspends Python's cyclic garbage collector, which takes a tenth of numba's time and finds little.

    What has been made meanwhile counts as old: enabling the collector would have it look through all of that at once.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            if not gc.get_freeze_count():  # frozen by nobody else, who would find their objects thawed
                gc.freeze()
                gc.unfreeze()
            gc.enable()


class _Lowerer(_FunctionCompiler):  # type: ignore[misc]
    def _customize_flags(self, flags: Any) -> Any:
        flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        return flags


class _ForPython(_FunctionCompiler):  # type: ignore[misc]
    """Compiles a lowered kernel together with the wrapper through which Python calls it."""

    def __init__(self, kernel: Kernel) -> None:
        super().__init__(kernel.py_func, kernel.targetdescr, kernel.targetoptions, kernel.locals, None)
        self._kernel = kernel

    def _compile_core(self, args: Any, return_type: Any) -> Any:
        lowered = self._kernel.lower(tuple(args), return_type)
        result, context = lowered.result, lowered.result.target_context
        context.refresh()  # numba's declarations, which reading a lowered kernel does not load
        library = context.codegen().create_library(lowered.library.name)
        library.enable_object_caching()
        library.add_linking_library(lowered.library)
        releases = bool(self.targetoptions.get("nogil"))
        wrapping = result.fndesc, result.environment, result.call_helper
        context.create_cpython_wrapper(library, *wrapping, release_gil=releases)
        entry = context.get_executable(library, result.fndesc, result.environment)
        return result._replace(library=library, entry_point=entry)


@cache
def _passes(pipeline: Any) -> str:
    """Returns a text that determines the passes by which kernels are lowered; those of numba have its version."""
    source = Path(str(sys.modules[pipeline.__module__].__file__))
    return "" if pipeline is compiler.Compiler else hashlib.sha256(source.read_bytes()).hexdigest()


def _widened(one: Any) -> Any:
    """Returns the type with which a kernel receives an argument of type `one` from another kernel.

    Integers are passed as int64, whatever their width, and constants as values, so that a kernel is lowered once for
    all of them. Types of less than 64 bits have no other arithmetic: numba computes with int64.
    """
    one = types.unliteral(one)
    return types.int64 if isinstance(one, types.Integer) and one.bitwidth < 64 else one


class Kernel(CPUDispatcher):  # type: ignore[misc]
    """numba's dispatcher for calls from Python; calling kernels receive only the IR."""

    targetdescr = _Target("cpu")
    _compiler: Any

    def __init__(
        self, py_func: Any, locals: Any = None, targetoptions: Any = None, pipeline_class: Any = compiler.Compiler
    ) -> None:
        super().__init__(py_func, locals, targetoptions, pipeline_class)
        self._pipeline_class = pipeline_class
        self._lowered: dict[tuple[Any, ...], Lowered] = {}
        self._templates: dict[tuple[Any, ...], Any] = {}  # to make a class takes longer than to look one up
        self.kept_in: Callable[[], Sequence[Path]] | None = None
        """Returns the folders of what is made of this kernel; None: nothing is stored."""

    @cached_property
    def _lowerer(self) -> _Lowerer:
        return _Lowerer(self.py_func, self.targetdescr, self.targetoptions, self.locals, self._pipeline_class)

    def keep(self, folders: Callable[[], Sequence[Path]]) -> None:
        """Loads machine code from `folders`, which is called when it is needed, and writes new code to the last."""
        self._cache = _KeptCode(self.py_func, folders)
        self.kept_in = folders

    def compile(self, sig: Any) -> Any:
        if not isinstance(self._compiler, _ForPython):
            self._compiler = _ForPython(self)
        kept = isinstance(self._cache, _KeptCode) and tuple(normalize_signature(sig)[0]) not in self.overloads
        with (
            global_compiler_lock,  # first: who has the lock of a file waits for nobody
            self._cache.made_once(sig, self.targetctx) if kept else nullcontext(),
            without_collector(),
        ):
            return super().compile(sig)

    def lower(self, types: tuple[Any, ...], returns: Any = None) -> Lowered:
        """Lowers the kernel for arguments of `types`.

        Raises:
            numba.core.errors.NumbaError: the kernel, or a function that it calls, cannot be compiled.
        """
        with global_compiler_lock, without_collector():
            if (known := self._lowered.get(types)) is not None:
                return known
            stored = self._stored(types) if returns is None else None
            lowered = stored.read(self.targetctx) if stored is not None else None
            if lowered is None:
                lowered = self._lower(types, returns)
                if stored is not None:
                    with suppress(_Unsettled):
                        lowered = stored.write(lowered)
            result = lowered.result
            self.targetctx.insert_user_function(lowered.library, result.fndesc, [lowered.library])
            self.targetctx.codegen().written[lowered.name] = lowered.library
            self._lowered[types] = lowered
            return lowered

    def _lower(self, types: tuple[Any, ...], returns: Any) -> Lowered:
        with self._compiling_counter:
            try:
                result = self._lowerer.compile(types, returns)
            except errors.ForceLiteralArg as error:
                raise error.bind_fold_arguments(
                    lambda args, kws: self._lowerer.fold_argument_types(args, kws)[1]
                ) from None
        result.library.is_of_kernel = True
        return Lowered(result, result.library)

    def _stored(self, types: tuple[Any, ...]) -> _Stored | None:
        """Returns the place of the IR for arguments of `types`; None if there is none that other processes could use.

        Exceptions have the path of the source, and symbols the name of the module, which is another one where a file
        is imported by its path. Both are therefore part of the digest.
        """
        if self.kept_in is None:
            return None
        code = self.py_func.__code__
        tools = numba_version, llvmlite_version, sys.version_info[:2], self.targetctx.codegen().magic_tuple()
        how = sorted(self.targetoptions.items()), _passes(self._pipeline_class), int(_config.OPT), _config.BOUNDSCHECK
        where = code.co_filename, self.py_func.__module__, self.py_func.__qualname__, code.co_firstlineno
        what = repr((*where, list(map(str, types)), how, tools))
        if " at 0x" in what:  # a function of this process
            return None
        digest = hashlib.sha256(what.encode()).hexdigest()[:32]
        file = self.kept_in()[-1] / f"{self.py_func.__qualname__}-{digest}.lowered"
        return _Stored(self.py_func, types, file, digest)

    def get_call_template(self, args: Any, kws: Any) -> Any:
        signature, types = self._lowerer.fold_argument_types(args, kws)
        types = tuple(map(_widened, types))
        lowered = self.lower(types)
        if (template := self._templates.get(types)) is None:
            name = self.py_func.__name__
            template = typing.make_concrete_template(f"CallTemplate({name})", key=name, signatures=[lowered.signature])
            self._templates[types] = template
        return template, signature, types, {}

    def get_overload(self, sig: Any) -> Any:
        return self._lowered[tuple(normalize_signature(sig)[0])].library


# ---- those who wait for a compilation --------------------------------------------------------------------------------


class _Listener(event.Listener):  # type: ignore[misc]
    """Tells of kernels for which machine code is made."""

    def on_start(self, happened: Any) -> None:
        for tell in on_compilation:
            tell(happened.data["dispatcher"].py_func, True)

    def on_end(self, happened: Any) -> None:
        for tell in on_compilation:
            tell(happened.data["dispatcher"].py_func, False)


event.register("numba:compile", _Listener())


# ---- copies of slices ------------------------------------------------------------------------------------------------


class _OnStack:
    """Context that allocates the memory for a copy on the stack and releases it."""

    def __init__(self, context: Any, builder: Any) -> None:
        self._context, self.nrt = context, self
        self._before = cgutils.alloca_once(builder, cgutils.voidptr_t)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def allocate(self, builder: Any, size: Any) -> Any:
        save = builder.module.declare_intrinsic("llvm.stacksave.p0", (), llvm_ir.FunctionType(cgutils.voidptr_t, ()))
        builder.store(builder.call(save, ()), self._before)
        return builder.alloca(llvm_ir.IntType(8), size)

    def free(self, builder: Any, _: Any) -> None:
        kind = llvm_ir.FunctionType(llvm_ir.VoidType(), (cgutils.voidptr_t,))
        restore = builder.module.declare_intrinsic("llvm.stackrestore.p0", (), kind)
        builder.call(restore, (builder.load(self._before),))


_maybe_copy_source = arrayobj.maybe_copy_source


def _copy_source(context: Any, builder: Any, *arguments: Any) -> Any:
    """Compiles ``m.v[1:] = m.v[:2]``: overlapping slices are copied through the stack, since kernels do not
    allocate.
    """
    within = context if context.enable_nrt else _OnStack(context, builder)
    return _maybe_copy_source(within, builder, *arguments)


arrayobj.maybe_copy_source = _copy_source
shortcuts.use()
folding.use()
