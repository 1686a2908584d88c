"""FMUs without a binary for this platform are compiled from their sources, and kept."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from cosim.kernel import cache_folder
from cosim_master.diagnostics.errors import SystemDescriptionError
from cosim_master.execution.options import RunOptions
from cosim_master.execution.simulate import simulate
from cosim_master.fmi.description.read import describe, platform
from tests.master.fmus.dynamics import SOURCE

pytestmark = pytest.mark.usefixtures("own_cache")
BUILD = """<fmiBuildDescription fmiVersion="3.0"><BuildConfiguration modelIdentifier="Dynamic">
<SourceFileSet language="C99"><SourceFile name="dynamic.c"/>
<PreprocessorDefinition name="MODEL" value="{}"/><PreprocessorDefinition name="FMI" value="3"/></SourceFileSet>
</BuildConfiguration></fmiBuildDescription>"""


def build(dynamics: Any, fmi: int, text: str, name: str = "s.fmu") -> Path:
    extra = {"sources/dynamic.c": text}
    if fmi == 3:
        extra["sources/buildDescription.xml"] = BUILD.format(1)
    file: Path = dynamics.fmu(
        "DAHLQUIST", fmi, "CS", name=name, stop=1.0, step=0.25, sources=True, binary=False, extra=extra
    )
    return file


@pytest.mark.parametrize("fmi", [2, 3])
def test_sources_are_compiled_once(dynamics: Any, tmp_path: Path, fmi: int) -> None:
    defined = "#define MODEL 1\n#define FMI 2\n" if fmi == 2 else ""
    file = build(dynamics, fmi, f"/* {tmp_path} */\n{defined}{SOURCE.read_text()}")
    note = "it has no binary for this platform: its sources are compiled"
    assert note in describe(file).notes
    result = simulate(file, RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    assert any(note in text for text in result.notes)
    binary = dynamics.fmu("DAHLQUIST", fmi, "CS", stop=1.0, step=0.25, name="b.fmu")
    simulate(binary, RunOptions(out=tmp_path / "binary"))
    mine, other = (pq.read_table(tmp_path / name / "signals.parquet")["Dahlquist.x"] for name in ("out", "binary"))
    np.testing.assert_allclose(mine.to_numpy(), other.to_numpy(), rtol=1e-14)
    (kept,) = (cache_folder() / "sources").glob(f"{describe(file).digest[:24]}-*.so")
    before = kept.stat().st_mtime_ns
    simulate(file, RunOptions(out=tmp_path / "again"))
    assert kept.stat().st_mtime_ns == before


def test_what_the_compiler_says(dynamics: Any, tmp_path: Path) -> None:
    result = simulate(build(dynamics, 2, f"/* {tmp_path} */ int x = ;\n"), RunOptions(out=tmp_path / "out"))
    assert result.outcome == "failed"
    assert "Dahlquist: compiling its sources failed: ./dynamic.c: the compiler refused" in str(result.error)
    assert "expected expression" in str(result.error)


def test_names_of_microsofts_c_library(dynamics: Any, tmp_path: Path) -> None:
    """Sources written there call strdup _strdup; what nobody has stays an error."""
    calls = '#include <string.h>\nint more(void) { return _strdup("") != 0 && _stricmp("a", "A") == 0; }\n'
    file = build(dynamics, 3, f"/* {tmp_path} */\n{SOURCE.read_text()}\n{calls}")
    result = simulate(file, RunOptions(out=tmp_path / "out"))
    assert result.outcome == "done", result.error
    unknown = calls.replace("_stricmp", "_stricmp_of_nobody")
    file = build(dynamics, 3, f"/* {tmp_path} */\n{SOURCE.read_text()}\n{unknown}", name="unknown.fmu")
    result = simulate(file, RunOptions(out=tmp_path / "unknown"))
    assert "call to undeclared function '_stricmp_of_nobody'" in str(result.error)


CONFIGURATION = """<fmiBuildDescription fmiVersion="3.0">
<BuildConfiguration modelIdentifier="Dynamic"{}>
<SourceFileSet language="C99"{}>
{}
</SourceFileSet>
{}
</BuildConfiguration>
</fmiBuildDescription>"""


def refused(
    dynamics: Any, inside: str, after: str = "", ofset: str = "", head: str = "", more: dict[str, str] | None = None
) -> str:
    extra = {
        "sources/buildDescription.xml": CONFIGURATION.format(head, ofset, inside, after),
        "sources/dynamic.c": "",
        "outside.c": "int outside;\n",
        **(more or {}),
    }
    file = dynamics.fmu("DAHLQUIST", 3, "CS", step=0.25, sources=True, binary=False, extra=extra)
    with pytest.raises(SystemDescriptionError) as caught:
        describe(file)
    return str(caught.value).replace(f"{file}/sources/buildDescription.xml", "build")


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("../outside.c", 'leads out with ".."; it must lie in the FMU\'s sources/'),
        ("a/../../outside.c", 'leads out with ".."; it must lie in the FMU\'s sources/'),
        ("/etc/hostname.c", "is absolute; it must be relative to the FMU's sources/"),
        ("C:/a.c", "is absolute; it must be relative to the FMU's sources/"),
        ("C:a.c", "is absolute; it must be relative to the FMU's sources/"),
        ("..\\outside.c", 'has a backslash; folders are separated by "/"'),
        ("-include.c", 'begins with "-", as options of a compiler do'),
        ("@dynamic.c", 'begins with "@", as options of a compiler do'),
        ("", "needs a name of printable characters"),
    ],
)
def test_names_that_lead_elsewhere(dynamics: Any, name: str, said: str) -> None:
    file = refused(dynamics, f'<SourceFile name="{name}"/>')
    assert file == f'build:4: <SourceFile> "{name}": {said}'
    folder = refused(dynamics, f'<SourceFile name="dynamic.c"/>\n<IncludeDirectory name="{name}"/>')
    assert folder == f'build:5: <IncludeDirectory> "{name}": {said}'


def test_files_that_are_no_sources(dynamics: Any) -> None:
    said = refused(dynamics, '<SourceFile name="dynamix.c"/>\n<SourceFile name="script.ld"/>')
    assert said.splitlines() == [
        'build:4: sources/dynamix.c is not in the archive; did you mean "dynamic.c"?',
        'build:5: <SourceFile> "script.ld" is not C or C++; valid: .c, .cc, .cpp, .cxx',
    ]
    assert refused(dynamics, '<SourceFile name="dynamic.h"/>') == (
        "build:2: <BuildConfiguration> of Dynamic lists no <SourceFile>"
    )


def test_names_of_fmi2_that_lead_elsewhere(dynamics: Any) -> None:
    file = dynamics.fmu("DAHLQUIST", 2, "CS", step=0.25, sources=True, binary=False, extra={"sources/dynamic.c": ""})
    with zipfile.ZipFile(file) as old:
        members = {name: old.read(name) for name in old.namelist()}
    text = members["modelDescription.xml"].replace(b'File name="dynamic.c"', b'File name="../../dynamic.c"')
    with zipfile.ZipFile(file, "w") as new:
        for name, content in {**members, "modelDescription.xml": text}.items():
            new.writestr(name, content)
    with pytest.raises(
        SystemDescriptionError, match=r'modelDescription\.xml:3: <File> "\.\./\.\./dynamic\.c": leads out'
    ):
        describe(file)


def test_links_in_the_archive(dynamics: Any) -> None:
    file = build(dynamics, 3, "", name="linked.fmu")
    with zipfile.ZipFile(file, "a") as archive:
        entry = zipfile.ZipInfo("sources/linked.c")
        entry.external_attr = 0o120777 << 16
        archive.writestr(entry, "/etc/hostname")
    with pytest.raises(SystemDescriptionError, match=r'entry "sources/linked\.c" is a link or a special file'):
        describe(file)


def definition(attributes: str) -> str:
    return f'<SourceFile name="dynamic.c"/>\n<PreprocessorDefinition {attributes}/>'


@pytest.mark.parametrize("name", ["", "A -include /etc/hostname", "-fplugin", "A=1", "@file"])
def test_definitions_that_are_no_macros(dynamics: Any, name: str) -> None:
    said = f'build:5: <PreprocessorDefinition> "{name}" is not the name of a macro (letters, digits and "_")'
    assert refused(dynamics, definition(f'name="{name}"')) == said


def test_values_of_definitions(dynamics: Any) -> None:
    said = 'build:5: <PreprocessorDefinition> "A" has a value with control characters'
    assert refused(dynamics, definition('name="A" value="1&#10;#include"')) == said


@pytest.mark.parametrize(
    "option",
    [
        "-include",
        "-I/etc",
        "-o/etc/x",
        "-Wl,-rpath=/x",
        "-Wp,-MD,/x",
        "-fplugin=/x.so",
        "-Xclang",
        "@/etc/hostname",
        "-B/x",
        "--config=/x",
        "-MF/x",
        "-mllvm",
        "-specs=/x",
        "/etc/hostname",
        "-DA=B/x",
        "-L/x",
    ],
)
def test_options_of_the_compiler(dynamics: Any, option: str) -> None:
    said = refused(dynamics, '<SourceFile name="dynamic.c"/>', ofset=f' compilerOptions="-O2 {option}"')
    assert said.startswith(f'build:3: compilerOptions: "{option}" is not allowed; allowed: -O, -std=, -W, ')


@pytest.mark.parametrize("name", ["-lc", ":../../x.so", "../x", "/lib/x.so", "", "a b", "a,b"])
def test_libraries_of_the_system(dynamics: Any, name: str) -> None:
    said = refused(dynamics, '<SourceFile name="dynamic.c"/>', f'<Library name="{name}" external="true"/>')
    assert said == f'build:6: <Library> "{name}" is not the name of a library of the system, such as "m"'


def test_sources_for_another_platform(dynamics: Any) -> None:
    said = refused(dynamics, '<SourceFile name="dynamic.c"/>', head=' platform="riscv64-none"')
    assert said == f"build:2: its sources are for riscv64-none, not for this platform ({platform(3)})"


def test_what_a_build_description_may_say(dynamics: Any, tmp_path: Path) -> None:
    """Definitions, folders, options and libraries reach the compiler; options for another one are left out."""
    inside = (
        '<SourceFile name="core/./dynamic.c"/>\n<PreprocessorDefinition name="MODEL" value="1"/>\n'
        '<PreprocessorDefinition name="NEVER" optional="true"/><IncludeDirectory name="./headers/"/>'
    )
    text = f'#include "third.h"\n#ifdef NEVER\n#error never\n#endif\n/* {tmp_path} */\n{SOURCE.read_text()}'
    extra = {
        "sources/core/dynamic.c": text,
        "sources/headers/third.h": "#ifdef OF_SET\n#define FMI OF_SET\n#endif\n",
        "sources/buildDescription.xml": CONFIGURATION.format(
            f' platform="{platform(3)}"',
            ' compilerOptions="-O1 -DOF_SET=3 -fno-math-errno"',
            inside,
            '<Library name="m" external="true"/>',
        ),
    }
    file = dynamics.fmu("DAHLQUIST", 3, "CS", stop=1.0, step=0.25, sources=True, binary=False, extra=extra)
    description = describe(file)
    assert description.source_files is not None
    assert description.source_files.flags == (
        "-DMODEL=1",
        "-I./headers",
        "-O1",
        "-DOF_SET=3",
        "-fno-math-errno",
    )
    assert (description.source_files.files, description.source_files.libraries) == (("core/dynamic.c",), ("-lm",))
    assert simulate(file, RunOptions(out=tmp_path / "out")).outcome == "done"
    extra["sources/buildDescription.xml"] = CONFIGURATION.format(
        "", ' compiler="MSVC" compilerOptions="/O2 /fp:fast"', inside, ""
    )
    file = dynamics.fmu("DAHLQUIST", 3, "CS", step=0.25, sources=True, binary=False, extra=extra)
    copy = tmp_path / "copy.fmu"
    copy.write_bytes(file.read_bytes())
    for one in (file, copy):
        shown = f"{one}/sources/buildDescription.xml:3"
        assert f'{shown}: compilerOptions="/O2 /fp:fast" are for MSVC: they are left out' in describe(one).notes


def test_neither_binary_nor_sources(dynamics: Any) -> None:
    file = dynamics.fmu("DAHLQUIST", 2, "CS", binary=False)
    with pytest.raises(SystemDescriptionError, match="has no library for this platform"):
        describe(file)
