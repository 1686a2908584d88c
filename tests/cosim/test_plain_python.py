"""Kernels run as plain Python pass the same tests and give the same bits as compiled."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cosim import test_frames, test_messages, test_packets

TESTS = {
    test_frames: "not process",
    test_messages: "pymavlink or before",
    test_packets: "not process and not ahead",
}
"""Modules of tests -> those of their tests that are run, of packets with fewer examples: plain Python takes long."""

PROGRAM = """
import importlib.util, json, sys, pytest

class Fewer:
    def pytest_collection(self):
        import hypothesis
        hypothesis.settings.register_profile("fewer", max_examples=30)
        hypothesis.settings.load_profile("fewer")

found = {}
for file, chosen in json.loads(sys.argv[1]).items():
    plugins = [Fewer()] if file.endswith("test_packets.py") else []
    code = pytest.main([file, "-q", "-p", "no:cacheprovider", "-k", chosen], plugins)
    spec = importlib.util.spec_from_file_location("again", file)
    again = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(again)
    found[file] = code, again.digest()
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def plain() -> tuple[dict[str, tuple[int, str]], str]:
    """File -> pytest's exit code and the digest, and all that one process without numba has written; imported once."""
    chosen = {str(module.__file__): which for module, which in TESTS.items()}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, json.dumps(chosen)],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return json.loads(done.stdout.splitlines()[-1]), done.stdout


@pytest.mark.parametrize("module", TESTS, ids=lambda module: module.__name__.rpartition(".")[2])
def test_plain_python_in_its_own_process_gives_the_same(
    module: object, plain: tuple[dict[str, tuple[int, str]], str]
) -> None:
    ends, said = plain
    code, digest = ends[str(module.__file__)]  # type: ignore[attr-defined]
    assert code == 0, said[-6000:]
    assert digest == module.digest()  # type: ignore[attr-defined]
