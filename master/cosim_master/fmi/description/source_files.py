"""The build description of an FMU's sources: files, folders, definitions, options and libraries, checked.

The arguments of the compiler come from an untrusted file. Therefore a name is refused unless it is a file in the FMU's
own sources/, no name can be interpreted as an option of the compiler, and only listed options are allowed. This module
does not compile.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import PurePosixPath

from lxml import etree

from cosim_master.diagnostics.errors import Finding, Problem, Where
from cosim_master.diagnostics.limitations import SOURCE_LIBRARY
from cosim_master.diagnostics.names import near
from cosim_master.files.xml import line_of

__all__ = ["SourceFiles", "configured", "listed"]

_COMPILED = (".c", ".cc", ".cpp", ".cxx")
_HEADERS = (".h", ".hh", ".hpp", ".hxx")
_DEFINED = re.compile(r"[A-Za-z_]\w*(\([\w, .]*\))?", re.ASCII)
_LIBRARY = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_+.-]*", re.ASCII)
_TRUE = ("true", "1")
_OPTION = re.compile(
    r"-O[0123sg]?|-Ofast|-std=(c|gnu|iso)[0-9a-z+:]+|-ansi|-pedantic|-w|-W[a-z][a-z0-9-]{2,}(=[a-z0-9-]+)?|-g[0-3]?|"
    r"-pthread|-march=[a-z0-9_.+-]+|-mtune=[a-z0-9_.+-]+|-m(sse[0-9.]*|avx[0-9a-z]*|fma)|"
    r"-f(no-)?(fast-math|math-errno|trapping-math|finite-math-only|associative-math|signed-zeros|strict-aliasing|"
    r"wrapv|signed-char|unsigned-char|short-enums|common|exceptions|rtti|inline|unroll-loops|PIC|pic|visibility)|"
    r"-fvisibility=[a-z]+|-ffp-contract=[a-z]+|-D[A-Za-z_]\w*(=\w*)?",
    re.ASCII,
)
_OPTIONS = "-O, -std=, -W, -g, -march=, -mtune=, -m of SSE, AVX and FMA, -D of a word, -f of mathematics and aliasing"
_OURS = ("", "gcc", "g++", "clang", "clang++", "cc", "c++")


@dataclass(frozen=True, slots=True)
class SourceFiles:
    """The inputs of the compilation of a library.

    Attributes:
        files: the files below sources/, in the order of the description.
        flags: definitions, folders of headers (below sources/, "-I./name"), options.
        libraries: of this machine, as "-lname".
    """

    files: tuple[str, ...]
    flags: tuple[str, ...] = ()
    libraries: tuple[str, ...] = ()

    @property
    def is_cpp(self) -> bool:
        """True if any of the files is C++."""
        return any(not name.lower().endswith(".c") for name in self.files)


class _Judge:
    """Checks the names in a document against the members of the archive."""

    def __init__(self, shown: str, members: Sequence[str], problems: list[Problem], notes: list[str]) -> None:
        self.shown, self.problems, self.notes = shown, problems, notes
        self.members = {name.removeprefix("sources/") for name in members if name.startswith("sources/")}

    def problem(self, element: etree._Element, message: str) -> None:
        self.problems.append(Problem(Where(self.shown, line_of(element)), message))

    def path(self, element: etree._Element) -> str | None:
        """Returns the name of an element as a path below sources/; None, with a problem, if it leads elsewhere."""
        name = element.get("name", "")
        said = f'<{element.tag}> "{name}"'
        pure = PurePosixPath(name)
        if not name.strip() or not name.isprintable():
            self.problem(element, f"{said}: needs a name of printable characters")
        elif "\\" in name:
            self.problem(element, f'{said}: has a backslash; folders are separated by "/"')
        elif pure.is_absolute() or re.match("[A-Za-z]:", name):
            self.problem(element, f"{said}: is absolute; it must be relative to the FMU's sources/")
        elif ".." in pure.parts:
            self.problem(element, f'{said}: leads out with ".."; it must lie in the FMU\'s sources/')
        elif name.startswith(("-", "@")):
            self.problem(element, f'{said}: begins with "{name[0]}", as options of a compiler do')
        else:
            return str(pure)
        return None

    def file(self, element: etree._Element) -> str | None:
        """Returns the path of a file to be compiled; None for a header, or after a problem."""
        name = self.path(element)
        if name is None or name.lower().endswith(_HEADERS):
            return None
        if not name.lower().endswith(_COMPILED):
            self.problem(element, f'<{element.tag}> "{name}" is not C or C++; valid: {", ".join(_COMPILED)}')
        elif name not in self.members:
            there = [one for one in self.members if one.lower().endswith(_COMPILED)]
            self.problem(element, f"sources/{name} is not in the archive; {near(name, there)}")
        else:
            return name
        return None

    def definition(self, element: etree._Element) -> str | None:
        name, value = element.get("name", ""), element.get("value")
        if not _DEFINED.fullmatch(name):
            self.problem(element, f'<{element.tag}> "{name}" is not the name of a macro (letters, digits and "_")')
        elif value is not None and not value.isprintable():
            self.problem(element, f'<{element.tag}> "{name}" has a value with control characters')
        else:
            return f"-D{name}" if value is None else f"-D{name}={value}"
        return None

    def options(self, element: etree._Element) -> list[str]:
        """Returns the options of a set of files, if they are for a compiler like ours."""
        text = element.get("compilerOptions", "")
        compiler = element.get("compiler", "")
        if text.strip() and compiler.strip().lower() not in _OURS:
            message = f'compilerOptions="{text}" are for {compiler}: they are left out'
            self.notes.append(Finding(Where(self.shown, line_of(element)), message))
            return []
        try:
            words = shlex.split(text)
        except ValueError as error:
            self.problem(element, f'compilerOptions="{text}": {str(error).lower()}')
            return []
        for word in words:
            if not _OPTION.fullmatch(word):
                self.problem(element, f'compilerOptions: "{word}" is not allowed; allowed: {_OPTIONS}')
        return words

    def library(self, element: etree._Element) -> str | None:
        name = element.get("name", "")
        if element.get("external", "").strip() not in _TRUE:
            self.problem(element, SOURCE_LIBRARY.text(name))
        elif not _LIBRARY.fullmatch(name):
            text = f'<{element.tag}> "{name}" is not the name of a library of the system, such as "m"'
            self.problem(element, text)
        else:
            return f"-l{name.removesuffix('.lib')}"
        return None


def _each(read: Callable[[etree._Element], str | None], elements: Sequence[etree._Element]) -> tuple[str, ...]:
    return tuple(one for one in map(read, elements) if one is not None)


def configured(
    root: etree._Element,
    shown: str,
    identifier: str,
    platform: str,
    members: Sequence[str],
    problems: list[Problem],
    notes: list[str],
) -> SourceFiles | None:
    """Returns the build configuration of buildDescription.xml (FMI 3.0.2, 2.5.1.4) for the model, or None.

    Args:
        root: the root element of the document.
        shown: the document, for messages.
        identifier: modelIdentifier of the interface.
        platform: the platform in the notation of FMI 3, such as "x86_64-linux".
        members: the names in the archive.
        problems, notes: appended to.
    """
    judge = _Judge(shown, members, problems, notes)
    ours = [one for one in root.iterfind("BuildConfiguration") if one.get("modelIdentifier") == identifier]
    if not ours:
        return None
    fitting = [one for one in ours if one.get("platform", platform) == platform]
    if not fitting:
        others = ", ".join(sorted({one.get("platform", "") for one in ours}))
        judge.problem(ours[0], f"its sources are for {others}, not for this platform ({platform})")
        return None
    chosen = fitting[0]
    files = _each(judge.file, chosen.findall("SourceFileSet/SourceFile"))
    defined = [one for one in chosen.iter("PreprocessorDefinition") if one.get("optional", "") not in _TRUE]
    folders = _each(judge.path, list(chosen.iter("IncludeDirectory")))
    flags = [*_each(judge.definition, defined), *(f"-I./{name}" for name in folders)]
    for one in chosen.iterfind("SourceFileSet"):
        flags += judge.options(one)
    if not files and not problems:
        judge.problem(chosen, f"<BuildConfiguration> of {identifier} lists no <SourceFile>")
    return SourceFiles(files, tuple(flags), _each(judge.library, chosen.findall("Library")))


def listed(
    interface: etree._Element, shown: str, members: Sequence[str], problems: list[Problem], notes: list[str]
) -> SourceFiles:
    """Returns the build configuration from the SourceFiles of an FMI 2 interface; arguments as for `configured`."""
    judge = _Judge(shown, members, problems, notes)
    files = _each(judge.file, interface.findall("SourceFiles/File"))
    if not files and not problems:
        text = f"neither buildDescription.xml nor <{interface.tag}> says which files its sources are compiled from"
        judge.problem(interface, text)
    return SourceFiles(files)
