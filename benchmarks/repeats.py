"""How far the real ArduCopter repeats itself: the figures of flights that were recorded several times.

Takes folders in which `benchmarks.record` has recorded flights of tests/data/arducopter again, at another time after
the start (`--later`), and writes for each flight the figures of all its recordings, the distance between each two of
them and that of ours from each to `REPEATS`, which `benchmarks.fidelity` reads. What is known of other flights stays.
With `--nearest`, the recording that ours is nearest to becomes the project's: ArduCopter's noise chooses among several
outcomes of a flight, and ours should be one of them. `benchmarks.fidelity` counts such flights apart, since a nearest
recording is chosen by ours.

    python -m benchmarks.repeats FOLDER [FOLDER ...] [--nearest]
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.fidelity import REPEATS, RMS, compare, figures_of, fly, path_of, rms_of
from benchmarks.flights import Flight, body_of, read
from tests.models.copter import RECORDINGS


def spread(recordings: Sequence[Flight]) -> dict[str, Any]:
    """The figures of all recordings of a flight, and the rms of the distance between each two [m]."""
    found = [figures_of(flight) for flight in recordings]
    rms = []
    for one, other in combinations(recordings, 2):
        last = min(one.real["t"][-1], other.real["t"][-1])
        time = one.real["t"][one.real["t"] <= last]
        rms.append(rms_of(time, (one.real["t"], path_of(one)), (other.real["t"], path_of(other)))[0])
    figures = {
        name: [None if math.isnan(figures[name]) else round(figures[name], 3) for figures in found] for name in found[0]
    }
    return {"rms": [round(value, 3) for value in rms], "figures": figures}


def distance(flight: Flight) -> float:
    """The rms of the distance [m] of ours from a recording, with the errors of its estimate."""
    return compare(flight, fly(flight, {}))["rms"][1]


def tell(name: str, found: dict[str, Any]) -> None:
    """Prints how far the recordings of a flight are from each other and from ours."""
    ours, bound = found["ours"], RMS[body_of(name)]
    print(f"{name:30} {len(ours)} recordings, {max(found['rms']):.3f} m rms at most between two", end="; ")
    print(f"ours {min(ours):.3f} m from the nearest, within {bound} m of {sum(rms <= bound for rms in ours)}")


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n", 1)[0])
    parser.add_argument("folders", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, default=REPEATS)
    parser.add_argument("--nearest", action="store_true", help="keep the recordings that ours is nearest to")
    options = parser.parse_args(arguments)
    table = json.loads(options.out.read_text()) if options.out.exists() else {}
    for path in sorted(RECORDINGS.glob("*.csv.gz")):
        first = read(path)
        again = [folder / path.name for folder in options.folders if (folder / path.name).exists()]
        files = [path, *(file for file in again if _is_another(read(file), first))]
        if len(files) > 1:
            ours = [distance(read(file)) for file in files]
            order = sorted(range(len(files)), key=ours.__getitem__) if options.nearest else range(len(files))
            found = spread([read(files[i]) for i in order])
            table[first.name] = {**found, "ours": [round(ours[i], 3) for i in order], "nearest": options.nearest}
            tell(first.name, table[first.name])
            if files[order[0]] != path:
                path.write_bytes(files[order[0]].read_bytes())
    lines = ",\n".join(f" {json.dumps(name)}: {json.dumps(found)}" for name, found in sorted(table.items()))
    options.out.write_text(f"{{\n{lines}\n}}\n")


def _is_another(flight: Flight, first: Flight) -> bool:
    """Returns whether a recording is not the first one itself."""
    size = min(len(flight.real["n"]), len(first.real["n"]))
    return not np.array_equal(flight.real["n"][:size], first.real["n"][:size])


if __name__ == "__main__":
    main()
