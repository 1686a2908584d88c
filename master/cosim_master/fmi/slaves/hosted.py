"""FMUs whose functions run on another machine: libraries with the interface of `fmi2.Library`."""

from __future__ import annotations

from pathlib import Path

from cosim_master.diagnostics.errors import FmuError
from cosim_master.fmi.description.read import FmuDescription
from cosim_master.fmi.isolation.child import Limits, Process
from cosim_master.fmi.isolation.remote import Address, Refused, Remote
from cosim_master.fmi.slaves.isolated import IsolatedLibrary

__all__ = ["HostedLibrary"]


class HostedLibrary(IsolatedLibrary):
    """The binary of an FMU, loaded in a process of another machine.

    Args:
        address: where `uav-cosim serve` runs.
        token: its secret.

    Raises:
        FmuError: nobody listens there, the server refuses, or it cannot load the FMU.
    """

    def __init__(self, fmu: FmuDescription, address: Address, token: str, limits: Limits) -> None:
        self._host, self._token = address, token
        super().__init__(fmu, Path(fmu.library), Path(), limits)

    def _started(self, library: Path, loading: str) -> Process:  # noqa: ARG002
        def refused(text: str) -> FmuError:
            return FmuError(self.fmu.model_name, loading, f"{self._host}: {text}")

        try:
            remote = Remote(self.fmu.path, self.fmu.digest, self._host, self._token, self._limits)
        except Refused as error:
            raise refused(str(error)) from None
        except ConnectionRefusedError:
            fix = f"run `uav-cosim serve --port {self._host.port}` on that machine"
            raise refused(f"nobody listens there; {fix}") from None
        except OSError as error:
            raise refused(f"the connection failed: {error.strerror or error}") from None
        self.resources, self.python = remote.folder, remote.python
        self.resources_path = f"{remote.folder}/".encode() if remote.has_resources else None
        return remote
