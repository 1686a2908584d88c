"""Messages between the parts of a run by MPI: mpi4py with Open MPI, MPICH, or the library of a cluster.

MPI libraries wait by spinning. Parts that share their cores with others would then take milliseconds for a message, so
that `receive` polls a few hundred times, and naps between further polls.

A part whose process dies is reported by Open MPI 5 with fault tolerance (`mpirun --with-ft ulfm`, ULFM: User Level
Failure Mitigation), to all parts within about 10 ms, whichever part they wait for. Other launchers end all processes. A
part that lives and sends nothing is found by a time-out.

Parts wait for each other, so the part that another one waits for in vain need not be the one that is lost. Each tells
part 0 whom it misses, and part 0 names the one that is missed and misses nobody.
"""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.execution.partitions.transport import PartLost

__all__ = ["MpiTransport", "launched_by", "missing"]

_SPINS, _NAP, _LONGEST_NAP = 200, 20e-6, 1e-3
_SHARE = 0.05
"""Naps last so much of the time waited: a message is noticed as much later, and who waits long hardly computes."""
_LOOK = 3e-3
"""Seconds between two looks for parts that have died and for reports of them."""
_HEARING = 0.5
"""Seconds for which part 0 waits for other parts' reports of the same loss."""
_LONGER = 3
"""Part 0 may itself wait for a lost part, and then complete its files; others wait so many times longer for it."""
_REPORTS = 1
"""Tag of reports of lost parts to part 0."""
_PATIENCE = 30.0
"""Parts that read a system, load FMUs, compile kernels or complete files may take so many times longer."""
_DATA, _ENDED, _FAILED = b"d", b"e", b"f"
"""First byte of a message: a message; the part has ended; it fails, with the reason."""
_DIED, _SILENT = "its process has ended", "no message"
_RAISED = "it hangs, or is stopped or unreachable; a slow machine needs a longer --partition-timeout"
_PATIENT = f", {_PATIENCE:g} times --partition-timeout, as it starts or ends"
_SIZES = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MPI_LOCALNRANKS")


def launched_by(environment: Mapping[str, str] = os.environ) -> int:
    """Returns the number of processes that an MPI launcher has started with this one; 1 if none has."""
    for name in _SIZES:
        if environment.get(name, "").isdigit():
            return int(environment[name])
    if "PMIX_RANK" in environment and environment.get("SLURM_STEP_NUM_TASKS", "").isdigit():
        return int(environment["SLURM_STEP_NUM_TASKS"])
    return 1


def missing(error: ImportError | RuntimeError) -> SystemDescriptionError:
    """Returns the error of a run in parts without mpi4py, or without an MPI library that it can load."""
    text = f"a run in parts needs mpi4py and an MPI library ({error}); pip install 'uav-cosim[mpi]'"
    return SystemDescriptionError([Problem(Where("--partitions"), text)])


class MpiTransport:
    """The messages of this process among those that the launcher has started.

    Args:
        seconds: see `Transport`.
        hosts: the machine that each part needs, empty if any will do; none: part n is rank n.

    Attributes:
        library: the MPI library and its version.

    Raises:
        SystemDescriptionError: mpi4py is missing, or no process runs on a machine that a part needs.
    """

    def __init__(self, seconds: float, hosts: Sequence[str] = ()) -> None:
        try:
            from mpi4py import MPI
        except (ImportError, RuntimeError) as error:
            raise missing(error) from None
        self._mpi: Any = MPI
        self.seconds, self.host = seconds, socket.gethostname()
        names = MPI.COMM_WORLD.allgather(self.host)
        order = _places(names, hosts)
        self._comm: Any = MPI.COMM_WORLD.Split(0, order.index(MPI.COMM_WORLD.rank))
        self.part, self.parts = self._comm.rank, self._comm.size
        self.here = names.count(self.host)
        self._sending: list[tuple[Any, bytes]] = []
        self._gone: set[int] = set()
        self._ended: set[int] = set()
        self._reported = False
        self.library = str(MPI.Get_library_version()).partition(",")[0].partition("\n")[0].replace("\t", " ").strip()
        self._tells = _tells_of_dead(self._comm)

    def send(self, to: int, message: bytes) -> None:
        self._send(to, _DATA + message)

    def _send(self, to: int, message: bytes) -> None:
        self._sending = [(request, held) for request, held in self._sending if not _done(request)]
        try:
            self._sending.append((self._comm.Isend([message, self._mpi.BYTE], dest=to), message))
        except self._mpi.Exception as error:
            raise self._lost(to, error) from None

    def receive(self, source: int, *, patient: bool = False) -> bytes:
        """Returns the next message; see `Transport`."""
        if source in self._gone:
            raise PartLost(source, "it has ended", ended=source in self._ended)
        try:
            longer = _PATIENCE if patient else _LONGER if source == 0 else 1
            message = self._next(source, self.seconds * longer, _PATIENT if patient else "")
        except PartLost as error:
            raise self._agreed(error) from None
        kind, content = message[:1], message[1:]
        if kind == _DATA:
            return content
        self._gone.add(source)
        if kind == _ENDED:
            self._ended.add(source)
            raise PartLost(source, "it has ended", ended=True)
        raise self._agreed(PartLost(source, content.decode("utf-8", "replace")))

    def _next(self, source: int, limit: float, why: str) -> bytes:
        """Returns the next message with its kind; raises PartLost if any part has died, or the time is over.

        Args:
            limit: s; `why` it is this one.
        """
        status, spins, began = self._mpi.Status(), 0, time.monotonic()
        looked = began
        try:
            while (found := self._comm.Improbe(source=source, tag=0, status=status)) is None:
                spins += 1
                if spins > _SPINS:
                    now = time.monotonic()
                    time.sleep(min(max(_NAP, _SHARE * (now - began)), _LONGEST_NAP))
                    if now - looked >= _LOOK:
                        looked = now
                        self._look()
                        if now - began > limit:
                            raise PartLost(source, f"{_SILENT} for {limit:g} s{why}: {_RAISED}")
            message = bytearray(status.Get_count(self._mpi.BYTE))
            found.Recv([message, self._mpi.BYTE])
        except self._mpi.Exception as error:
            raise self._lost(source, error) from None
        return bytes(message)

    def _look(self) -> None:
        """Raises PartLost if a part has died, or, in part 0, if another part reports that one is lost.

        A part that has reported a loss waits for part 0, which completes its files and then ends all.
        """
        for part in self._dead():
            if part not in self._gone and (part == 0 or not self._reported):
                raise PartLost(part, _DIED)
        if self.part == 0 and (reported := self._report()) is not None:
            raise reported[1]

    def _dead(self) -> list[int]:
        """Returns the parts of which MPI knows that their processes have ended."""
        if not self._tells:
            return []
        failed = self._comm.Get_failed()
        dead = self._mpi.Group.Translate_ranks(failed, range(failed.size), self._comm.Get_group())
        failed.Free()
        return [int(part) for part in dead]

    def _report(self) -> tuple[int, PartLost] | None:
        """Returns the next report of a lost part, with the part that reports it; None if there is none."""
        status = self._mpi.Status()
        try:
            found = self._comm.Improbe(source=self._mpi.ANY_SOURCE, tag=_REPORTS, status=status)
            if found is None:
                return None
            message = bytearray(status.Get_count(self._mpi.BYTE))
            found.Recv([message, self._mpi.BYTE])
        except self._mpi.Exception:  # a part has died, so that any source may be it
            return None
        part, _, why = message.decode("utf-8", "replace").partition(" ")
        return status.Get_source(), PartLost(int(part), why)

    def _agreed(self, missed: PartLost) -> PartLost:
        """Returns the loss on which the parts agree; in other parts than 0, tells part 0 of a loss."""
        if self.part != 0:
            self._reported = True
            self._gone.add(missed.part)
            told = f"{missed.part} {missed.why}".encode()
            if missed.part != 0:
                with suppress(self._mpi.Exception):
                    self._sending.append((self._comm.Isend([told, self._mpi.BYTE], dest=0, tag=_REPORTS), told))
            return missed
        found: dict[int, PartLost] = {missed.part: missed}
        missing: set[int] = set()
        end = time.monotonic() + (_HEARING if missed.why.startswith(_SILENT) else 0.0)
        while True:
            for part in self._dead():
                if part not in self._gone:
                    self._gone.add(part)
                    return PartLost(part, _DIED)
            if (reported := self._report()) is not None:
                missing.add(reported[0])
                found.setdefault(reported[1].part, reported[1])
            elif time.monotonic() > end:
                break
            else:
                time.sleep(_LONGEST_NAP)
        lost = next((one for part, one in found.items() if part not in missing), missed)
        self._gone.add(lost.part)
        return lost

    def _lost(self, part: int, error: Any) -> PartLost:
        self._gone.add(part)
        failed = getattr(self._mpi, "ERR_PROC_FAILED", None)
        dead = failed is not None and error.Get_error_class() == failed
        return PartLost(part, _DIED if dead else f"MPI reports {error}")

    def fail(self, reason: str) -> None:
        """Tells all parts why this one fails; they end without it."""
        for other in range(self.parts):
            if other != self.part:
                with suppress(PartLost):
                    self._send(other, _FAILED + reason.encode())

    def close(self, *, abort: bool) -> None:
        """Ends the exchange; see `Transport`."""
        if abort:
            self._comm.Abort(1)
        others = [p for p in range(self.parts) if p != self.part and p not in self._gone]
        for other in (*others, *self._ended):  # one that has ended after an error waits for this part's end
            with suppress(PartLost):
                self._send(other, _ENDED)
        for other in others:
            with suppress(PartLost):
                while True:
                    self.receive(other)
        end = time.monotonic() + self.seconds
        while any(not _done(request) for request, _ in self._sending) and time.monotonic() < end:
            time.sleep(_NAP)


def _tells_of_dead(comm: Any) -> bool:
    """Returns whether the MPI library tells which processes have ended."""
    try:
        comm.Get_failed().Free()
    except (AttributeError, NotImplementedError, RuntimeError):  # RuntimeError: MPI's own exception
        return False
    return True


def _done(request: Any) -> bool:
    try:
        return bool(request.Test())
    except Exception:  # its receiver has died
        return True


def _places(names: Sequence[str], hosts: Sequence[str]) -> list[int]:
    """Returns the rank of each part: a rank on the machine that the part needs, and otherwise the next free one.

    Raises:
        SystemDescriptionError: there is no such machine, or it has too few processes.
    """
    left, found = list(range(len(names))), dict.fromkeys(range(len(names)), -1)
    for part, host in enumerate(hosts):
        if host:
            fitting = [rank for rank in left if host in (names[rank], names[rank].partition(".")[0])]
            if not fitting:
                text = f"part {part} needs a process on {host}; there are processes on {', '.join(sorted({*names}))}"
                raise SystemDescriptionError([Problem(Where("--partition-file"), text)])
            found[part] = fitting[0]
            left.remove(fitting[0])
    return [rank if rank >= 0 else left.pop(0) for rank in found.values()]
