"""The decorator of compiled functions."""

from __future__ import annotations

import importlib.util
import platform
import subprocess
import sys
from pathlib import Path

import pytest

import cosim_master.stepping.kernels.macro_step
from cosim.kernel import _code_folders, _imported, imported_sources

FOR = "from numba.core.registry import cpu_target; print(cpu_target.target_context.codegen().magic_tuple())"


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="others are compiled for what they are")
@pytest.mark.parametrize(
    "module",
    ["network.radio.intrinsics", "stepping.kernels.intrinsics", "execution.simulate"],
)
def test_all_is_compiled_for_one_processor_whatever_is_imported_first(module: str) -> None:
    """numba looks once, when it makes its first function; a cache of one processor is of no use for another."""
    imports = f"import cosim_master.{module}; from cosim.kernel import compiler; compiler(); "
    done = subprocess.run([sys.executable, "-c", imports + FOR], capture_output=True, text=True, check=True)
    assert done.stdout.strip().endswith("'x86-64-v2', '')")


def written(folder: Path, **modules: str) -> Path:
    """A package of these modules; the file of its module `a`."""
    package = folder / "some_package"
    package.mkdir()
    (package / "__init__.py").touch()
    for name, text in modules.items():
        (package / f"{name}.py").write_text(text)
    return package / "a.py"


def test_what_a_module_is_made_from_is_what_it_imports(tmp_path: Path) -> None:
    own = written(
        tmp_path,
        a="import numpy as np\nfrom some_package.b import (\n    one,\n    two as x,\n)\nfrom some_package import c\n",
        b="def f():\n    import some_package.d as d, cosim.frames\n",
        c="",
        d="from some_package.a import circle\n",
        e="from some_package import a\n",
    )
    found = imported_sources(own)
    assert {f.name for f in found if f.parent == own.parent} == {"a.py", "b.py", "c.py", "d.py"}
    assert {f.name for f in found if f.parent != own.parent} >= {"frames.py", "kernel.py"}


def test_kernels_are_compiled_anew_where_a_callee_in_another_file_changes_and_only_then(tmp_path: Path) -> None:
    own = written(tmp_path, a="from some_package.b import one\n", b="one = 1\n", c="two = 2\n")
    before = _code_folders(own)
    own.with_name("c.py").write_text("two = 3\n")
    _code_folders.cache_clear()
    _imported.cache_clear()
    assert _code_folders(own) == before
    own.with_name("b.py").write_text("one = 2\n")
    _code_folders.cache_clear()
    _imported.cache_clear()
    assert _code_folders(own) != before


def test_the_sources_of_a_kernel_are_read_when_it_is_called_and_not_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A program that imports hundreds of kernels calls a few of them."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    file = written(tmp_path, a="from cosim.kernel import kernel\n\n\n@kernel\ndef f(x):\n    return x + 1.0\n")
    spec = importlib.util.spec_from_file_location("some_package.a", file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    before = _code_folders.cache_info().misses
    spec.loader.exec_module(module)
    assert _code_folders.cache_info().misses == before
    assert module.f(1.0) == 2.0
    assert _code_folders.cache_info().misses == before + 1
    assert [path.name.partition("-")[0] for path in (tmp_path / "cache").rglob("*.kernel")] == ["f"]


def test_the_loop_does_not_depend_on_the_command_line() -> None:
    names = {file.name for file in imported_sources(Path(cosim_master.stepping.kernels.macro_step.__file__))}
    assert {"macro_step.py", "fmi_calls.py", "router.py", "tables.py", "packets.py", "kernel.py"} <= names
    assert not names & {"console.py", "simulate.py", "figures.py", "check.py"}


def test_code_is_kept_by_the_paths_of_modules(tmp_path: Path) -> None:
    """The same in each checkout; another one when a module moves, since code names the modules of its kernels."""
    names = []
    for checkout, folder in (("a", "pkg"), ("b", "pkg"), ("a", "pkg/room")):
        place = tmp_path / checkout / folder
        place.mkdir(parents=True, exist_ok=True)
        (place / "__init__.py").write_text("")
        (place / "law.py").write_text("from cosim import kernel\n")
        names.append(_code_folders(place / "law.py")[1].name)
    assert names[0] == names[1] != names[2]
