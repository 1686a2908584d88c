"""One short flight that all tests of formats export."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cosim_master import RunOptions, simulate
from cosim_master.results.export.formats import FORMATS, export_run
from cosim_master.results.export.options import Options


@pytest.fixture(scope="session")
def flown(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """line5 in the air: lossy radio, wind, recorded ten times a second."""
    return _fly(16.0, tmp_path_factory.mktemp("flown") / "flown")


@pytest.fixture(scope="session")
def begun(fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first two seconds of that flight: a film of it has 20 pictures."""
    return _fly(2.0, tmp_path_factory.mktemp("begun") / "begun")


def _fly(until: float, out: Path) -> Path:
    overrides = {
        "network.loss": "0.2",
        "network.jitter": "0.004",
        "recording.interval": "0.1",
        "drone*.vehicle.wind[2]": "3",
    }
    done = simulate("line5", RunOptions(until=until, overrides=overrides, out=out))
    assert done.error is None
    return out


class Exported(dict[str, Path]):
    """The files of all formats, by name; each is written when it is first asked for."""

    def __init__(self, run: Path, folder: Path) -> None:
        self._run, self._folder = run, folder

    def __missing__(self, name: str) -> Path:
        one = next(one for one in FORMATS if one.name == name)
        self[name] = self._folder / f"run{one.suffix or '_' + one.name}"
        export_run(self._run, one, self[name], Options())
        return self[name]


@pytest.fixture(scope="session")
def exported(flown: Path, tmp_path_factory: pytest.TempPathFactory) -> Exported:
    return Exported(flown, tmp_path_factory.mktemp("exported"))


def edited(run: Path, to: Path, change: object) -> Path:
    """A copy of a run's signals whose manifest `change` has changed."""
    to.mkdir()
    (to / "signals.parquet").symlink_to(run / "signals.parquet")
    manifest = json.loads((run / "manifest.json").read_text())
    change(manifest)  # type: ignore[operator]
    (to / "manifest.json").write_text(json.dumps(manifest))
    return to


def rotation(q: np.ndarray) -> np.ndarray:
    """The matrix of a unit quaternion w, x, y, z."""
    w, x, y, z = q
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
