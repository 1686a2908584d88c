"""Messages between the parts of a run by MPI: mpi4py with Open MPI, MPICH, or the library of a cluster.

MPI libraries wait by spinning. Parts that share their cores with others would then take milliseconds for a message, so
that `receive` polls a few hundred times, and naps between further polls.

A part whose process dies is reported by Open MPI 5 with fault tolerance (`mpirun --with-ft ulfm`, ULFM: User Level
Failure Mitigation). Other launchers end all processes. A part that lives and sends nothing is found by a time-out.
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

_SPINS, _NAP = 200, 20e-6
_PATIENCE = 1800.0
"""Seconds for messages of parts that read a system, load FMUs or compile kernels."""
_DATA, _ENDED, _FAILED = b"d", b"e", b"f"
"""First byte of a message: a message; the part has ended; it fails, with the reason."""
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
            raise PartLost(source, "it has ended")
        limit, spins, status = (_PATIENCE if patient else self.seconds), 0, self._mpi.Status()
        began = time.monotonic()
        try:
            while (found := self._comm.Improbe(source=source, status=status)) is None:
                spins += 1
                if spins > _SPINS:
                    time.sleep(_NAP)
                    if time.monotonic() - began > limit:
                        raise PartLost(source, f"no message for {limit:g} s: it hangs, or is stopped or unreachable")
            message = bytearray(status.Get_count(self._mpi.BYTE))
            found.Recv([message, self._mpi.BYTE])
        except self._mpi.Exception as error:
            raise self._lost(source, error) from None
        kind, content = bytes(message[:1]), bytes(message[1:])
        if kind == _DATA:
            return content
        self._gone.add(source)
        raise PartLost(source, content.decode("utf-8", "replace") if kind == _FAILED else "it has ended")

    def _lost(self, part: int, error: Any) -> PartLost:
        self._gone.add(part)
        failed = getattr(self._mpi, "ERR_PROC_FAILED", None)
        dead = failed is not None and error.Get_error_class() == failed
        return PartLost(part, "its process has ended" if dead else f"MPI reports {error}")

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
        for other in others:
            with suppress(PartLost):
                self._send(other, _ENDED)
        for other in others:
            with suppress(PartLost):
                while True:
                    self.receive(other)
        end = time.monotonic() + self.seconds
        while any(not _done(request) for request, _ in self._sending) and time.monotonic() < end:
            time.sleep(_NAP)


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
