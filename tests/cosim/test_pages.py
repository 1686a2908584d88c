"""Memory in large pages: what the kernel says about it (proc_pid_smaps(5)), in processes of their own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from cosim.build import build_all, load_models
from cosim.pages import variables

_SWITCH = Path("/sys/kernel/mm/transparent_hugepage/enabled")
_LARGE = _SWITCH.is_file() and "[never]" not in _SWITCH.read_text() and "CS_GNU_LIBC_VERSION" in os.confstr_names
needs_large_pages = pytest.mark.skipif(not _LARGE, reason="this machine has no large pages")

_SEEN = """
import re, sys, threading
from pathlib import Path
from cosim.pages import large_pages

def seen(key):
    return sum(int(kib) for kib in re.findall(rf"^{key}:\\s+(\\d+) kB", Path("/proc/self/smaps").read_text(), re.M))

def fill():
    return [bytes(bytearray(100_000)) for _ in range(1000)]  # 100 MB, of which malloc hands out each
"""


def _says(program: str, **environment: str) -> list[int]:
    done = subprocess.run(
        [sys.executable, "-c", _SEEN + program], capture_output=True, text=True, env={**os.environ, **environment}
    )
    assert done.stderr == ""
    return [int(word) for word in done.stdout.split()]


@needs_large_pages
def test_memory_handed_out_within_is_in_large_pages_and_returned_at_the_end() -> None:
    within, held, returned = _says(
        "before = seen('Rss')\n"
        "with large_pages(128 << 20):\n"
        "    held = fill()\n"
        "    print(seen('AnonHugePages'), seen('Rss') - before)\n"
        "    del held\n"
        "print(seen('Rss') - before)\n"
    )
    assert within > 50_000  # the kernel may have few large pages left
    assert 90_000 < held < 110_000  # what nobody asked for is not there
    assert returned < 10_000


@needs_large_pages
@pytest.mark.parametrize(
    "how",
    [
        "with large_pages(31 << 20): held = fill()",
        "def run():\n    with large_pages(128 << 20): held.extend(fill())\n"
        "held = []; one = threading.Thread(target=run); one.start(); one.join()",
    ],
    ids=["little memory", "another thread"],
)
def test_else_all_stays_as_it_is(how: str) -> None:
    plain, mapped = _says("held = fill()\nprint(seen('AnonHugePages'), seen('Rss'))")
    pages, resident = _says(how + "\nprint(seen('AnonHugePages'), seen('Rss'))")
    assert abs(pages - plain) < 20_000
    assert abs(resident - mapped) < 20_000


def test_more_than_the_process_may_have_is_no_error() -> None:
    limit = "import resource; resource.setrlimit(resource.RLIMIT_AS, (1 << 30, 1 << 30))\n"
    assert _says(limit + "with large_pages(1 << 40): print(len(fill()))\nprint(len(fill()))") == [1000, 1000]


@needs_large_pages
def test_a_process_with_the_variables_has_large_pages_from_its_start() -> None:
    (pages,) = _says("held = fill()\nprint(seen('AnonHugePages'))", **variables())
    assert pages > 50_000


@pytest.mark.parametrize(("name", "value"), [("GLIBC_TUNABLES", "glibc.malloc.check=1"), ("PYTHONMALLOC", "debug")])
def test_where_the_user_has_set_one_there_are_none(monkeypatch: pytest.MonkeyPatch, name: str, value: str) -> None:
    for one in ("GLIBC_TUNABLES", "PYTHONMALLOC"):
        monkeypatch.delenv(one, raising=False)
    monkeypatch.setenv(name, value)
    assert variables() == {}


def test_another_c_library_gets_no_variables(monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(_: str) -> str:
        raise ValueError("unrecognized configuration name")

    for one in ("GLIBC_TUNABLES", "PYTHONMALLOC"):
        monkeypatch.delenv(one, raising=False)
    monkeypatch.setattr(os, "confstr", unknown)
    assert variables() == {}


def test_processes_that_build_have_them_and_this_one_has_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The models write what their process was given where they are imported."""
    for name in ("GLIBC_TUNABLES", "PYTHONMALLOC"):
        monkeypatch.delenv(name, raising=False)
    names = list(variables())
    (tmp_path / "own_models").mkdir()
    (tmp_path / "own_models" / "__init__.py").touch()
    for name in ("First", "Second"):
        (tmp_path / "own_models" / f"{name.lower()}.py").write_text(
            "import os\nfrom pathlib import Path\nfrom cosim import Model, Output, kernel\n"
            f"given = ' '.join(name for name in {names!r} if name in os.environ)\n"
            f"Path({str(tmp_path)!r}, f'{name}-{{os.getpid()}}').write_text(given)\n"
            "@kernel\ndef start(m): return 0\n@kernel\ndef advance(m, t, h): return 0\n"
            f"class {name}(Model):\n    'A model.'\n    step_size = 0.1\n    variables = (Output('y', unit='m'),)\n"
            "    kernels = (start, advance)\n"
        )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    chosen = [model for name in ("first", "second") for model in load_models(f"own_models.{name}")]
    assert len(list(build_all(chosen, tmp_path / "fmus", interpreted=True))) == 2
    said = {file.name: file.read_text() for file in tmp_path.glob("*-*")}
    own = {f"{name}-{os.getpid()}" for name in ("First", "Second")}
    assert {said.pop(name) for name in own} == {""}
    assert set(said.values()) == {" ".join(names)}
    assert not set(names) & set(os.environ)
