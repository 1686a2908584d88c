"""A stand-in for an FMU that is not available: it says again what a recording of a run has of it."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

from tests.master.fmus.probe import slave

_SOURCE = '''
from pythonfmu import Fmi2Causality, Fmi2Slave, Real

ROWS = {rows!r}
STEP = {step!r}


class {name}(Fmi2Slave):
    """Says what was recorded; takes any input."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        for name, value in ROWS[0].items():
            setattr(self, name, value)
            self.register_variable(Real(name, causality=Fmi2Causality.output))
        for name in {inputs!r}:
            setattr(self, name, 0.0)
            self.register_variable(Real(name, causality=Fmi2Causality.input))

    def do_step(self, t, h):
        for name, value in ROWS[min(round((t + h) / STEP), len(ROWS) - 1)].items():
            setattr(self, name, value)
        return True
'''


def recording(file: Path) -> list[dict[str, float]]:
    """Rows of a CSV file of Maestro."""
    with file.open(newline="") as lines:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(lines)]


def stand_in(
    folder: Path, name: str, rows: Sequence[dict[str, float]], prefix: str, inputs: Sequence[str], step: float
) -> Path:
    """An FMU `name` with the recorded outputs whose column begins with `prefix`."""
    own = [{n.removeprefix(prefix): x for n, x in row.items() if n.startswith(prefix)} for row in rows]
    return slave(folder, f"{name.lower()}_stand_in.py", _SOURCE.format(name=name, rows=own, inputs=inputs, step=step))
