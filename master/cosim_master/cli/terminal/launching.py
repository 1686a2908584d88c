"""Processes of a run in parts: started on this machine, or by an MPI launcher before this command begins."""

from __future__ import annotations

import logging
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType
from typing import TYPE_CHECKING, NoReturn

import typer

from cosim_master.cli.terminal.console import err, note, out, report_error, usage
from cosim_master.diagnostics.errors import CosimError

if TYPE_CHECKING:
    from cosim_master.execution.options import RunOptions
    from cosim_master.execution.partitions.transport import Transport

__all__ = ["exit_code_told", "hear_end", "leave", "left", "part_of", "serve_part", "start_parts"]

_COMMAND = (sys.executable, "-c", "from cosim_master.cli import main; main()")
_STATUS = "UAV_COSIM_EXIT_CODE"
"""Environment variable with the file for the exit code of part 0: that of mpirun depends on which one ends first."""
_ASKED, _TAKEN = "asked", "taken"
"""Files beside that one: as many bytes as the user has asked for the end, and as part 0 has heard of it."""
_AGAIN = 0.5
"""Seconds after which the launcher is told again: while it starts processes, it loses signals."""
_early: list[int] = []
"""Signals that part 0 has got before it could tell the others of its end."""
_TURN = 10.0
"""Seconds that other parts leave to part 0 to tell an error that all have."""
_RANKS = ("OMPI_COMM_WORLD_RANK", "PMI_RANK", "PMIX_RANK")


def start_parts(parts: int, arguments: Sequence[str]) -> int:
    """Starts this command in `parts` processes on this machine; returns the exit code of part 0, or that of Ctrl-C.

    Ctrl-C, SIGTERM and SIGHUP end the run as in one process: the launcher passes SIGUSR1 on, which part 0 takes as
    Ctrl-C. It is sent until part 0 has it, or has ended.
    """
    with TemporaryDirectory(prefix="uav-cosim-", ignore_cleanup_errors=True) as folder:  # parts may still write there
        return _started(parts, arguments, Path(folder))


def _started(parts: int, arguments: Sequence[str], folder: Path) -> int:
    own = Path(sys.executable).parent
    launcher = shutil.which("mpirun", path=f"{own}{os.pathsep}{os.environ.get('PATH', '')}")
    if launcher is None:
        raise usage("--partitions needs mpirun; pip install 'uav-cosim[mpi]'")
    said = subprocess.run([launcher, "--version"], capture_output=True, text=True, check=False).stdout
    options = ["-n", str(parts)]
    file = folder / "code"
    environment = {**os.environ, _STATUS: str(file)}
    if "Open MPI" in said:
        # With --oversubscribe, processes give up the processor at each look for messages: milliseconds a window.
        options += ["--with-ft", "ulfm", "--host", f"localhost:{parts}", "--bind-to", "none"]
        environment["OMPI_MCA_opal_signal"] = ""  # crashes are for `execution.run.faults.crashes` to report
        environment.setdefault("OMPI_MCA_btl", "^ofi")  # a second of looking for networks, which one machine needs not
        # Its files are named by its process id: it does not start where a killed one with the same id left them.
        environment.setdefault("PRTE_MCA_prte_tmpdir_base", str(folder))
        if os.geteuid() == 0:  # as in a container; the parts are those of this user
            environment |= {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    process: subprocess.Popen[bytes] | None = None

    def passed_on(number: int, _frame: FrameType | None) -> None:
        if number != signal.SIGALRM:
            _lengthen(folder / _ASKED)
        if _length(folder / _TAKEN) < _length(folder / _ASKED):
            if process is not None:
                process.send_signal(signal.SIGUSR1)
            signal.setitimer(signal.ITIMER_REAL, _AGAIN)

    before = {signal.SIGALRM: signal.signal(signal.SIGALRM, passed_on)}
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        if number == signal.SIGINT or signal.getsignal(number) not in (signal.SIG_IGN, None):  # as SIGHUP under nohup
            before[number] = signal.signal(number, passed_on)
    try:
        process = subprocess.Popen([launcher, *options, *_COMMAND, *arguments], env=environment, start_new_session=True)
        code = process.wait()
        if file.is_file():
            return int(file.read_text())
        with suppress(ProcessLookupError):  # the launcher, or part 0, was not ready to take a signal; or it was killed
            os.killpg(process.pid, signal.SIGTERM)
        if _length(folder / _ASKED):
            _end_all(f"{_STATUS}={file}")  # the signal may have ended the launcher alone
            report_error("interrupted")
            return 130
        how = f"by signal {-code}" if code < 0 else f"with exit code {code}"
        report_error(f"part 0 has ended without a result (mpirun {how}); if it has recorded, try uav-cosim repair RUN")
        return 1
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        for number, handler in before.items():
            signal.signal(number, handler)


def _end_all(variable: str) -> None:
    """Ends all processes that have this variable in their environment, where Linux tells it."""
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # of another user; or it has just ended
            if variable.encode() in (process / "environ").read_bytes().split(b"\0"):
                os.kill(int(process.name), signal.SIGKILL)


def _length(file: Path) -> int:
    return file.stat().st_size if file.is_file() else 0


def _lengthen(file: Path, by: int = 1) -> None:
    with file.open("ab") as opened:
        opened.write(b"." * by)


def hear_end(transport: Transport | None) -> None:
    """Lets SIGUSR1 interrupt part 0, which can tell the others from now on; one that came earlier does so now."""
    if transport is not None:
        signal.signal(signal.SIGUSR1, _asked_to_end)
        if _early:
            _asked_to_end(_early.pop(), None)


def _asked_to_end(_number: int, _frame: FrameType | None) -> None:
    """Takes SIGUSR1, in part 0, as one Ctrl-C for each time that the user has asked, however often it is sent."""
    if name := os.environ.get(_STATUS):
        asked, taken = Path(name).with_name(_ASKED), Path(name).with_name(_TAKEN)
        if (new := _length(asked) - _length(taken)) <= 0:
            return
        _lengthen(taken, new)
    os.kill(os.getpid(), signal.SIGINT)


@contextmanager
def exit_code_told() -> Iterator[None]:
    """Notes the exit code of a command that `start_parts` has started."""
    try:
        yield
    except SystemExit as end:
        _tell(end.code if isinstance(end.code, int) else int(end.code is not None))
        raise
    except BaseException:
        _tell(1)
        raise


def _tell(code: int) -> None:
    """Notes the exit code of part 0, which alone speaks."""
    if (file := os.environ.get(_STATUS)) and not out.quiet:
        Path(file).write_text(str(code))


def part_of(
    parts: int | None, file: Path | None, seconds: float | None, check: Callable[[int], object]
) -> Transport | None:
    """Returns the messages of this process as a part of a run; None if the run has one process.

    If a launcher has not started the parts, this starts them, and exits with the exit code of part 0.

    Args:
        parts: the number that the user asks for; None leaves it to the launcher.
        file: parts and machines, see `partitions.cut.read_assignment`.
        seconds: wall-clock time without a message after which a part counts as lost; None: a minute.
        check: raises the reason why the system cannot be cut into this many parts. It is asked before processes are
            started that would take turns at the processor, and for minutes come to nothing.
    """
    from cosim_master.execution.partitions.mpi import launched_by

    there = launched_by()
    if parts is not None and parts > 1 and there == 1:
        if parts > (cores := os.cpu_count() or 1):
            check(parts)
            note(f"{parts} parts take turns at {cores} processors, which is slower than {cores} parts or one")
        raise typer.Exit(start_parts(parts, sys.argv[1:]))
    if there == 1:
        if file is not None:
            raise usage("--partition-file belongs to --partitions, which is not given")
        if seconds is not None:
            raise usage("--partition-timeout belongs to --partitions, which is not given")
        return None
    if parts not in (None, there):
        raise usage(f"--partitions {parts}: the launcher has started {there} processes; give no number, or {there}")
    from cosim_master.execution.partitions.cut import read_assignment
    from cosim_master.execution.partitions.mpi import MpiTransport

    first = all(os.environ.get(name, "0") == "0" for name in _RANKS)
    try:
        hosts = () if file is None else read_assignment(file, there).hosts
    except CosimError:
        if not first:  # the first process to end ends all: let it be part 0, unless the file is wrong here only
            time.sleep(_TURN)
        raise
    out.quiet = err.quiet = not first  # what is wrong from here on is wrong for all
    transport = MpiTransport(60.0 if seconds is None else seconds, hosts)
    if transport.parts == 1:
        text = f"the launcher has started {there} processes, but {transport.library} sees one: it is not the launcher's"
        raise usage(f"{text} MPI library; name that one by MPI4PY_LIBMPI (docs/distributed.md)")
    if transport.part == 0:
        out.quiet = err.quiet = False
        signal.signal(signal.SIGUSR1, lambda number, _: _early.append(number))
    else:  # part 0 ends the run, also when the launcher sends a signal to all, and reports it
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1):
            signal.signal(number, signal.SIG_IGN)
        out.quiet = err.quiet = True
        logging.getLogger("cosim_master").setLevel(logging.CRITICAL)
    return transport


def serve_part(system: str, options: RunOptions, transport: Transport, *, mailbox: bool) -> NoReturn:
    """Runs a part other than part 0 to its end, and exits; a lost part ends all others.

    Args:
        mailbox: whether part 0 takes packets of the live page or of ROS.
    """
    from cosim_master.execution.partitions.transport import PartLost
    from cosim_master.execution.simulate import take_part

    lost = False
    try:
        take_part(system, options, transport, mailbox=mailbox)
    except PartLost as error:
        try:  # part 0 completes its files, and then ends all parts
            while not error.ended:
                transport.receive(0, patient=True)
        except PartLost as further:
            error = further
        lost = not (error.part == 0 and error.ended)
    except CosimError:
        pass  # part 0 has the error
    transport.close(abort=lost)
    raise typer.Exit(int(lost))


def left(transport: Transport | None) -> Callable[..., bool]:
    """Returns an exit callback that ends the exchange of part 0 if an exception ends its run before it has a result."""

    def leave_after(_kind: object, error: BaseException | None, _trace: object) -> bool:
        if error is not None and transport is not None:
            if not isinstance(error, CosimError | KeyboardInterrupt):
                transport.fail(f"it has failed: {type(error).__name__}: {error}")
            leave(transport, error)
        return False

    return leave_after


def leave(transport: Transport | None, error: BaseException | None) -> None:
    """Ends the exchange of part 0; the loss of a part ends all others."""
    if transport is not None:
        from cosim_master.execution.partitions.transport import PartLost

        sys.stdout.flush()
        sys.stderr.flush()
        if isinstance(error, PartLost):
            _tell(1)
        transport.close(abort=isinstance(error, PartLost))
