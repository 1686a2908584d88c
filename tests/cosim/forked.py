"""Python programs in processes of their own that need not import anything: forks of one that has.

Imports are most of the processor time of a short program. The process that forks has one thread and has run nothing.
Forks have its hash seed: what must not depend on that is a matter for a process of its own.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

__all__ = ["Forked", "forking_after"]

_PROGRAM = """
import atexit, ctypes, gc, json, os, sys, threading

out, err, before = sys.argv[1:]
exec(before)
gc.collect()
gc.freeze()  # otherwise, the collection at the end of a fork copies all memory
assert threading.active_count() == 1
for line in sys.stdin:
    job = json.loads(line)
    if (child := os.fork()) == 0:
        break
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
else:
    sys.exit()
os.environ.clear()
os.environ.update(job["environment"])
for number, name in enumerate((os.devnull, out, err)):
    file = os.open(name, os.O_RDWR | (os.O_TRUNC if number else 0))
    os.dup2(file, number)
    os.close(file)
sys.dont_write_bytecode = True  # modules of a test change within the second that bytecode is compared by
sys.path[1:1] = job["paths"]
sys.argv = ["-c", *job["arguments"]]
exec(compile(job["program"], "<string>", "exec"), {"__name__": "__main__"})
# Ends as Python does, except that Python also takes all modules apart: the system would copy all memory for that.
threading._shutdown()
atexit._run_exitfuncs()
sys.stdout.flush()
sys.stderr.flush()
ctypes.CDLL(None).fflush(None)
os._exit(0)
"""


class Forked:
    """A process that forks for each program."""

    def __init__(self, process: subprocess.Popen[str], out: Path, err: Path) -> None:
        self._process, self._out, self._err = process, out, err

    def run(
        self, program: str, *arguments: str, paths: tuple[Path, ...] = (), environment: Mapping[str, str] | None = None
    ) -> subprocess.CompletedProcess[str]:
        """The end of a program, as that of `subprocess.run` with captured text.

        Args:
            arguments: its `sys.argv[1:]`.
            paths: where it finds modules before all others.
            environment: that of this process if there is none.
        """
        assert self._process.stdin is not None and self._process.stdout is not None
        job = {
            "program": program,
            "arguments": arguments,
            "paths": [str(path) for path in paths],
            "environment": {**(os.environ if environment is None else environment)},
        }
        self._process.stdin.write(json.dumps(job) + "\n")
        self._process.stdin.flush()
        code = int(self._process.stdout.readline())
        return subprocess.CompletedProcess([program, *arguments], code, self._out.read_text(), self._err.read_text())


@contextmanager
def forking_after(before: str) -> Iterator[Forked]:
    """Starts the process, which runs the program `before`, and ends it."""
    with TemporaryDirectory(prefix="uav-cosim-forked-") as folder:
        out, err = Path(folder, "out"), Path(folder, "err")
        for file in (out, err):
            file.touch()
        command = [sys.executable, "-c", _PROGRAM, str(out), str(err), before]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
            yield Forked(process, out, err)
            assert process.stdin is not None
            process.stdin.close()
            assert process.wait(60) == 0
