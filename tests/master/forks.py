"""Commands of `uav-cosim` in processes of their own that need not import anything: forks of one that has.

Imports are two thirds of the processor time of a short command. The process that forks has one thread and has run
nothing; a fork ends as an interpreter does that has executed `from cosim_master.cli import main; main()`: see
`TO_ITS_END`.
"""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path

__all__ = ["TO_ITS_END", "Forks", "forking"]

TO_ITS_END = """
try:
    main()
except SystemExit as end:
    import atexit, contextlib, ctypes, os, sys, threading
    if end.code is None or isinstance(end.code, int):
        threading._shutdown()
        atexit._run_exitfuncs()
        with contextlib.suppress(OSError):  # of a full disk: Python tries again, says so, and has a code of its own
            sys.stdout.flush()
            sys.stderr.flush()
            ctypes.CDLL(None).fflush(None)
            os._exit((end.code or 0) & 0xFF)
    raise
"""
"""Runs `main` in a fork and ends the fork as Python ends, except that Python also takes all modules apart.

The system would copy all memory for that, which takes half of the processor time of a short command.
"""

_PROGRAM = """
import gc, json, os, sys, threading
from contextlib import suppress
from importlib import import_module
from cosim.kernel import PLAIN, compiler
from cosim_master.cli import main
import cosim_master.execution.simulate

if not PLAIN:
    compiler()

# What commands import as they go, but nothing that reads the environment, which is another one in a fork.
for name in (
    "typer", "typer._adapters", "rich.console", "rich.live", "rich.progress", "rich.table", "rich._emoji_codes",
    "pydantic.functional_validators", "pydantic.type_adapter", "pyarrow.acero", "matplotlib.backends.backend_svg",
    "matplotlib.figure", "matplotlib.style", "pymavlink.dialects.v20.ardupilotmega", "http.client", "webbrowser",
    "fmpy.validation", "cosim.build", "cosim.messages", "cosim_master.network.radio.logs",
    "cosim_master.results.export.formats", "cosim_master.results.reading.comparison",
    "cosim_master.system.authoring.swarm.new",
):
    with suppress(ImportError):
        import_module(name)
gc.collect()
gc.freeze()  # otherwise, the collection at the end of a fork copies all memory, which takes as long as the imports
assert threading.active_count() == 1
for line in sys.stdin:
    job = json.loads(line)
    if (child := os.fork()) == 0:
        break
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
else:
    sys.exit()
os.chdir(job["folder"])
os.environ.clear()
os.environ.update(job["environment"])
for number, name in enumerate((os.devnull, job["out"], job["err"])):
    file = os.open(name, os.O_RDWR)
    os.dup2(file, number)
    os.close(file)
sys.argv = ["-c", *job["words"]]
"""

_PLAIN = re.compile(r"uav-cosim(?: (?:[\w./:=@,+-]|'[^']*')+)+(?:\s+#.*)?")
"""A command of words, single quotes and a comment, which mean the same to `shlex` and to a shell."""


class Forks:
    """A process that forks for each command."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process

    def run(
        self, words: list[str], folder: Path, environment: Mapping[str, str], output: Path | None = None
    ) -> subprocess.CompletedProcess[str]:
        """The end of a command, as that of `subprocess.run` with captured text.

        Args:
            words: those behind `uav-cosim`.
            folder: where it runs; the files `stdout` and `stderr` beside it have what it prints.
            output: the device that takes its standard output instead.
        """
        kept, err = (folder.with_name(f"{folder.name}-{name}") for name in ("stdout", "stderr"))
        for file in (kept, err):
            file.write_bytes(b"")
        out = output or kept
        job = {"words": words, "folder": str(folder), "environment": {**environment}, "out": str(out), "err": str(err)}
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(json.dumps(job) + "\n")
        self._process.stdin.flush()
        code = int(self._process.stdout.readline())
        return subprocess.CompletedProcess(words, code, kept.read_text(), err.read_text())

    def shell(self, text: str, folder: Path, environment: Mapping[str, str]) -> subprocess.CompletedProcess[str]:
        """The end of lines of a shell, as that of `bash -e`: commands `uav-cosim ...` are forks, bash runs the others.

        Args:
            text: the lines.
        """
        out, err, code = "", "", 0
        for plain, group in groupby(text.strip().splitlines(), lambda line: _PLAIN.fullmatch(line) is not None):
            for part in group if plain else ["\n".join(group)]:
                if plain:
                    done = self.run(shlex.split(part, comments=True)[1:], folder, environment)
                else:
                    command = ["bash", "-e", "-c", part]
                    done = subprocess.run(
                        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
                    )
                out, err, code = out + done.stdout, err + done.stderr, done.returncode
                if code:
                    return subprocess.CompletedProcess(part, code, out, err)
        return subprocess.CompletedProcess(text, code, out, err)


@contextmanager
def forking(environment: Mapping[str, str] | None = None) -> Iterator[Forks]:
    """Starts the process, and ends it.

    Args:
        environment: the one in which it imports this project; that of this process if there is none.
    """
    command = [sys.executable, "-c", _PROGRAM + TO_ITS_END]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
    ) as process:
        yield Forks(process)
        assert process.stdin is not None
        process.stdin.close()
        assert process.wait(60) == 0
