"""Reads projects of MasterSim (.msim) as systems.

    simulator 0 1 Tank #6a5acd "fmus/Tank.fmu"      a slave: number, cycle, name, color, an FMU or a table (.csv, .tsv)
    graph Pump.flow Tank.inflow 0 2.5               a connection; optionally with offset and factor
    parameter Tank.area 0.4                         a start value
    hStart 10 min                                   a setting

GAUSS_JACOBI is our Jacobi, GAUSS_SEIDEL our Gauss-Seidel in the order of cycles and lines, with its iterations; NEWTON
is our quasi-Newton, STEP_DOUBLING our Richardson. As in MasterSim, units are not converted.
Settings that cannot be followed are errors or notes.
"""

from __future__ import annotations

import math
import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.limitations import MASTERSIM_IGNORED, MASTERSIM_ITERATION, MASTERSIM_STEPS
from cosim_master.diagnostics.names import near
from cosim_master.files.xml import double
from cosim_master.fmi.description.read import describe
from cosim_master.system.reading.others.mastersim_table import Columns, read_columns
from cosim_master.system.reading.ssp.references import is_file
from cosim_master.system.structure import (
    Annotation,
    Component,
    Connection,
    Connector,
    ExtractedArchive,
    LinearTransformation,
    Parameter,
    ParameterBinding,
    System,
    SystemStructure,
    Value,
    annotation,
)

__all__ = ["read_mastersim"]

_FMU_TYPE = "application/x-fmu-sharedlibrary"
_SECONDS: Mapping[str, Fraction | int] = {
    "ms": Fraction(1, 1000),
    "s": 1,
    "min": 60,
    "h": 3600,
    "d": 86400,
    "a": 365 * 86400,
}
_TIMES = {
    "tStart": "0 s",
    "tEnd": "1 a",
    "hStart": "10 min",
    "hMax": "30 min",
    "hMin": "1e-5 s",
    "hFallBackLimit": "1e-3 s",
    "hOutputMin": "10 min",
}
_WORDS = {
    "outputTimeUnit": "s",
    "adjustStepSize": "no",
    "preventOversteppingOfEndTime": "yes",
    "absTol": "1e-6",
    "relTol": "1e-5",
    "MasterMode": "GAUSS_SEIDEL",
    "ErrorControlMode": "NONE",
    "maxIterations": "1",
    "writeInternalVariables": "no",
    "writeUnconnectedFileReaderVars": "no",
    "outputOnly": "",
}
"""The settings, with the values that MasterSim uses if they are missing."""
_CHOICES = {
    "MasterMode": ("GAUSS_JACOBI", "GAUSS_SEIDEL", "NEWTON"),
    "ErrorControlMode": ("NONE", "CHECK", "STEP_DOUBLING", "ADAPT_STEP"),
}
_TRUE = ("true", "yes", "1")


@dataclass(frozen=True, slots=True)
class _Slave:
    name: str
    cycle: int
    source: Path | None
    where: Where
    columns: Columns | None = None
    types: Mapping[str, str] = field(default_factory=dict)
    """The types of the FMU's variables."""


def read_mastersim(path: Path) -> SystemStructure:
    """Reads a project of MasterSim.

    Returns:
        The structure; its errors are in `problems`, as for every system.

    Raises:
        SystemDescriptionError: the file cannot be read.
    """
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise SystemDescriptionError([Problem(Where(str(path)), f"cannot be read: {error.strerror}")]) from None
    except UnicodeDecodeError:
        message = "is not a project of MasterSim: it is not UTF-8"
        raise SystemDescriptionError([Problem(Where(str(path)), message)]) from None
    return _Reading(path, text).structure()


class _Reading:
    def __init__(self, given: Path, text: str) -> None:
        self.given = given
        self.problems: list[Problem] = []
        self.notes: list[str] = []
        self._set: dict[str, tuple[str, Where]] = {}
        self._slaves: dict[str, _Slave] = {}
        self._ports: dict[str, dict[str, Connector]] = {}
        self._values: dict[str, dict[str, Parameter]] = {}
        self._archive: ExtractedArchive | None = None
        lines = [(Where(str(given), n), line.strip()) for n, line in enumerate(text.splitlines(), start=1)]
        self._lines = [(where, line) for where, line in lines if line and not line.startswith("#")]

    def _problem(self, where: Where, message: str) -> None:
        self.problems.append(Problem(where, message))

    def structure(self) -> SystemStructure:
        links: list[tuple[Where, str]] = []
        values: list[tuple[Where, str]] = []
        for where, line in self._lines:
            word, _, rest = (*re.split(r"([ \t]+)", line, maxsplit=1), "", "")[:3]
            if word == "simulator":
                self._slave(where, rest)
            elif word == "graph":
                links.append((where, rest))
            elif word == "parameter":
                values.append((where, rest))
            elif word in _TIMES or word in _WORDS:
                self._set[word] = (rest.strip(), where)
            else:
                known = (*_TIMES, *_WORDS, "simulator", "graph", "parameter")
                self._problem(where, f'there is no keyword "{word}"; {near(word, known)}')
        for where, rest in values:
            self._parameter(where, rest)
        connections = [one for where, rest in links if (one := self._connection(where, rest)) is not None]
        where = Where(str(self.given))
        if not self._slaves:
            self._problem(where, 'has no simulators: it needs lines "simulator NUMBER CYCLE NAME #COLOR FMU"')
        annotations = self._annotations(where)
        components = tuple(self._component(slave) for slave in self._slaves.values())
        document = self.given.absolute()
        system = System(self.given.stem, (), (), components, tuple(connections), annotations, document, where)
        return SystemStructure(
            name=self.given.stem,
            version="1.0",
            path=self.given,
            document=document,
            system=system,
            where=where,
            start_time=self._time("tStart"),
            stop_time=self._time("tEnd"),
            problems=tuple(self.problems),
            notes=tuple(self.notes),
            archives=() if self._archive is None else (self._archive,),
        )

    # ---- slaves, connections, values ---------------------------------------------------------------------------------

    def _tokens(self, where: Where, text: str) -> list[str]:
        reader = shlex.shlex(text, posix=True)
        reader.whitespace, reader.quotes, reader.escape, reader.commenters = " \t", '"', "", ""
        reader.whitespace_split = True
        try:
            return list(reader)
        except ValueError:
            self._problem(where, "a quotation mark is not closed")
            return []

    def _slave(self, where: Where, text: str) -> None:
        tokens = self._tokens(where, text)
        if len(tokens) != 5 or not tokens[1].isdecimal():
            if tokens:
                self._problem(where, 'a slave is written "simulator NUMBER CYCLE NAME #COLOR FMU"')
            return
        name = tokens[2]
        if "." in name:
            self._problem(where, f'the name of a slave must not contain a dot: "{name}"')
        elif name in self._slaves:
            self._problem(where, f'there is a second slave "{name}"')
        else:
            self._slaves[name] = self._sourced(name, int(tokens[1]), tokens[4], where)

    def _sourced(self, name: str, cycle: int, written: str, where: Where) -> _Slave:
        source = self.given.absolute().parent / written.replace("\\", "/")
        kind = source.suffix.lower()
        if kind not in (".fmu", ".csv", ".tsv"):
            self._problem(where, f'"{written}" is not a slave; valid: an .fmu, a .csv or .tsv file')
        elif not is_file(source):
            self._problem(where, f'there is no file "{written}"')
        elif kind == ".fmu":
            try:
                types = {one.name: one.type for one in describe(source).variables.values()}
            except SystemDescriptionError:  # reported by `check`
                types = {}
            return _Slave(name, cycle, source, where, types=types)
        else:
            columns = read_columns(source, _SECONDS, self.problems)
            return _Slave(name, cycle, None if columns is None else source, where, columns)
        return _Slave(name, cycle, None, where)

    def _end(self, where: Where, text: str) -> tuple[str, str] | None:
        slave, dot, variable = text.partition(".")
        if not (slave and dot and variable):
            self._problem(where, f'"{text}" is not a variable; it is written SLAVE.VARIABLE')
        elif slave not in self._slaves:
            self._problem(where, f'there is no slave "{slave}"; {near(slave, self._slaves)}')
        else:
            return slave, variable
        return None

    def _parameter(self, where: Where, text: str) -> None:
        name, _, rest = (*re.split(r"([ \t]+)", text.strip(), maxsplit=1), "", "")[:3]
        end = self._end(where, name)
        written = rest.strip().replace("\\\\", "\\").replace("\\n", "\n")
        if len(written) > 1 and written[0] == written[-1] == '"':
            written = written[1:-1]
        if end is None or self._slaves[end[0]].source is None:
            return
        slave, variable = self._slaves[end[0]], end[1]
        if slave.columns is not None:
            self._problem(where, f'"{name}": {slave.name} is a table, which has no parameters')
        elif slave.types and variable not in slave.types:
            self._problem(where, f'{slave.name} has no variable "{variable}"; {near(variable, slave.types)}')
        elif slave.types:  # else the FMU is invalid, which `check` reports
            kind, value = _kind(slave.types[variable]), _value(slave.types[variable], written)
            if value is None:
                valid = {"Real": "a number", "Integer": "an integer", "Boolean": "true or false"}
                self._problem(where, f'"{name}" is {kind} and cannot be "{written[:60]}"; valid: {valid[kind]}')
            else:
                self._values.setdefault(slave.name, {})[variable] = Parameter(variable, kind, value, where)

    def _connection(self, where: Where, text: str) -> Connection | None:
        tokens = self._tokens(where, text)
        if len(tokens) not in (2, 4, 6):
            if tokens:
                self._problem(where, 'a connection is written "graph OUTPUT INPUT [OFFSET FACTOR [WIDTH COLOR]]"')
            return None
        source, target = self._end(where, tokens[0]), self._end(where, tokens[1])
        numbers = [double(one) for one in tokens[2:4]]
        if any(one is None or abs(one) > 1e300 or one != one for one in numbers):
            self._problem(where, f"offset and factor must be numbers, not {tokens[2]} and {tokens[3]}")
            return None
        if source is None or target is None:
            return None
        if self._slaves[target[0]].columns is not None:
            self._problem(where, f'"{tokens[1]}": {target[0]} is a table, which has no inputs')
            return None
        kind = self._slaves[target[0]].types.get(target[1], "Real")
        linear = None
        if numbers and (numbers[0], numbers[1]) != (0.0, 1.0):
            if _kind(kind) == "Real":
                linear = LinearTransformation(float(numbers[1] or 0.0), float(numbers[0] or 0.0), where)
            else:
                self.notes.append(f"{where}: offset and factor act on Reals only, as in MasterSim; this is {kind}")
        self._port(source, "output", kind, where)
        self._port(target, "input", kind, where)
        return Connection(*source, *target, where, True, linear)

    def _port(self, end: tuple[str, str], kind: str, type: str, where: Where) -> None:
        slave, ports = self._slaves[end[0]], self._ports.setdefault(end[0], {})
        if slave.columns is None:
            ports.setdefault(end[1], Connector(end[1], "input" if kind == "input" else "output", where))
        elif end[1] not in slave.columns.names:
            self._problem(where, f'{slave.name} has no column "{end[1]}"; {near(end[1], slave.columns.names)}')
        else:
            type = _kind(type)
            made = ports.setdefault(end[1], Connector(end[1], "output", where, type))
            if made.type != type:
                self._problem(where, f'"{".".join(end)}" is connected to a {made.type} and to a {type}')
            elif type not in ("Real", "Integer", "Boolean"):
                self._problem(where, f'"{".".join(end)}": a column has numbers, and the input is a {type}')

    def _component(self, slave: _Slave) -> Component:
        values = tuple(self._values.get(slave.name, {}).values())
        bindings = (ParameterBinding(values, "", slave.where),) if values else ()
        ports, source, type = self._ports.get(slave.name, {}), slave.source, _FMU_TYPE
        if slave.columns is not None:
            if self._is("writeUnconnectedFileReaderVars"):
                for name in slave.columns.names:
                    ports.setdefault(name, Connector(name, "output", slave.where, "Real"))
            if self._archive is None:
                self._archive = ExtractedArchive()
            type, source = "text/csv", self._archive.directory / f"{slave.name}.csv"
            slave.columns.write(source)
        return Component(slave.name, type, source, "any", tuple(ports.values()), bindings, (), slave.where)

    # ---- settings ----------------------------------------------------------------------------------------------------

    def _where(self, key: str) -> Where:
        return self._set.get(key, ("", Where(str(self.given))))[1]

    def _word(self, key: str) -> str:
        word = self._set.get(key, (_WORDS[key], None))[0]
        if key in _CHOICES and word not in _CHOICES[key]:
            self._problem(self._where(key), f'{key} is "{word}"; valid: {", ".join(_CHOICES[key])}')
            self._set[key] = (_WORDS[key], self._where(key))
            return _WORDS[key]
        return word

    def _is(self, key: str) -> bool:
        return self._word(key) in _TRUE

    def _time(self, key: str) -> float:
        """Returns a time or duration in s."""
        text, where = self._set.get(key, (_TIMES[key], Where(str(self.given))))
        parts = text.split()
        number = double(parts[0]) if len(parts) == 2 and parts[1] in _SECONDS else None
        if number is not None and abs(number) < 1e15:
            return float(Fraction(parts[0]) * _SECONDS[parts[1]]) if number else 0.0  # "1e-999999999" takes hours
        self._problem(where, f'{key} is "{text}"; it must be a number and a unit of: {", ".join(_SECONDS)}')
        self._set[key] = (_TIMES[key], where)
        return self._time(key)

    def _number(self, key: str) -> float:
        number = double(self._word(key))
        if number is None or not 0.0 <= number < 1e9 or (key == "maxIterations" and number != int(number)):
            what = "a whole number" if key == "maxIterations" else "a number"
            self._problem(self._where(key), f'{key} is "{self._word(key)}"; it must be {what}, not negative')
            self._set[key] = (_WORDS[key], self._where(key))
            return float(_WORDS[key])
        return number

    def _annotations(self, where: Where) -> tuple[Annotation, ...]:
        for key in _TIMES:  # also those that are not needed are checked
            self._time(key)
        for key in ("absTol", "relTol", "maxIterations"):
            self._number(key)
        step = self._time("hStart") or (self._time("tEnd") - self._time("tStart")) / 1000
        if step <= 0.0:
            self._problem(self._where("hStart"), "hStart must be positive, and tEnd later than tStart")
            step = 1.0
        if (master := self._master(step)) is not None and master["algorithm"] == "richardson":
            step = self._grid(step)
        made = [annotation("org.uav-cosim.stepping", "stepping", {"stepSize": repr(step)}, self._where("hStart"))]
        if master is not None:
            made.append(annotation("org.uav-cosim.master", "master", master, self._where("MasterMode")))
        rows = self._time("hOutputMin")
        if rows > step * (1 + 1e-9):
            if abs(rows / step - round(rows / step)) < 1e-9 * rows / step:
                interval = {"interval": repr(rows)}
                made.append(annotation("org.uav-cosim.recording", "recording", interval, self._where("hOutputMin")))
            else:
                text = f"hOutputMin, {rows:g} s, is not a multiple of hStart: every step is recorded"
                self.notes.append(f"{self._where('hOutputMin')}: {text}")
        ignored = ["relTol, which MasterSim passes to FMUs"] if "relTol" in self._set else []
        ignored += (
            ["writeInternalVariables (--record '*' selects signals)"] if self._is("writeInternalVariables") else []
        )
        ignored += [key for key in ("outputTimeUnit", "outputOnly") if self._word(key) != _WORDS[key]]
        ignored += ["ErrorControlMode CHECK, which only reports"] if self._word("ErrorControlMode") == "CHECK" else []
        if not self._is("preventOversteppingOfEndTime"):
            ignored.append("preventOversteppingOfEndTime no: a run ends at tEnd")
        if ignored:
            self.notes.append(f"{where}: {MASTERSIM_IGNORED.text('; '.join(ignored))}")
        return tuple(made)

    def _grid(self, step: float) -> float:
        """Returns the grid of adjusted steps: hStart, or its largest part (down to a thousandth) that divides the run.

        MasterSim shortens the last step to end at tEnd; here, steps end at the rows of a grid.
        """
        whole, run = round(step * 1e9), round((self._time("tEnd") - self._time("tStart")) * 1e9)
        part = math.gcd(whole, run)
        if part == whole or part * 1000 < whole:
            return step
        text = f"hStart, {step:g} s, does not divide the run: the first step and the grid of rows are {part / 1e9:g} s"
        self.notes.append(f"{self._where('hStart')}: {text}")
        return part / 1e9

    def _master(self, step: float) -> dict[str, str] | None:
        """Returns the attributes of our master; None for Jacobi with fixed steps."""
        mode, tries = self._word("MasterMode"), int(self._number("maxIterations"))
        doubling = self._word("ErrorControlMode") in ("STEP_DOUBLING", "ADAPT_STEP")
        where, adjusting = self._where("adjustStepSize"), self._is("adjustStepSize")
        tolerance = min(self._number("absTol"), self._number("relTol")) or 1e-8
        if mode == "GAUSS_JACOBI" and tries > 1:
            self._problem(self._where("maxIterations"), "GAUSS_JACOBI does not iterate: maxIterations must be 1")
        elif mode == "NEWTON" and tries <= 1:
            self._problem(self._where("MasterMode"), "NEWTON iterates: maxIterations must be larger than 1")
        elif doubling and not adjusting:
            self._problem(where, "ErrorControlMode adjusts steps: adjustStepSize must be yes")
        elif adjusting and not doubling and tries <= 1:
            self._problem(where, "adjustStepSize needs iterations or ErrorControlMode STEP_DOUBLING")
        elif adjusting and not doubling:
            self._problem(where, MASTERSIM_STEPS.text())
        elif doubling:
            iterated = f", and {mode} with {tries} iterations" if tries > 1 else ""
            tolerance = min(tolerance / step, 1.0)  # theirs is for a step, ours for a second
            text = f"error {tolerance:g} per s, exchange of Jacobi instead of {mode}'s{iterated}"
            self.notes.append(f"{self._where('ErrorControlMode')}: steps are controlled by richardson: {text}")
            steps = {"minimumStep": repr(self._time("hMin")), "maximumStep": repr(self._time("hMax"))}
            return {"algorithm": "richardson", "tolerance": repr(tolerance), **steps}
        elif mode == "NEWTON":
            self.notes.append(f"{self._where('maxIterations')}: {MASTERSIM_ITERATION.text(f'{tolerance:g}', tries)}")
            return {"algorithm": "quasi-newton", "tolerance": repr(tolerance)}
        elif mode == "GAUSS_SEIDEL":
            return self._gauss_seidel(tries if step >= self._time("hFallBackLimit") else 1, tolerance)
        return None

    def _gauss_seidel(self, tries: int, tolerance: float) -> dict[str, str]:
        """Returns the attributes of Gauss-Seidel in the order of cycles, each repeated `tries` times at most."""
        cycles: dict[int, list[str]] = {}
        for one in self._slaves.values():
            cycles.setdefault(one.cycle, []).append(one.name)
        parts = [" ".join(cycles[number]) for number in sorted(cycles)]
        if tries <= 1 or all(len(names) == 1 for names in cycles.values()):
            return {"algorithm": "gauss-seidel", "order": " ".join(parts), "strictOrder": "true"}
        text = f"a cycle is settled when no value changes by more than {tolerance:g}, relative to 1 or its size"
        self.notes.append(f"{self._where('maxIterations')}: {text}; MasterSim takes a mean of all changes")
        master = {"algorithm": "gauss-seidel", "order": " | ".join(parts), "strictOrder": "true"}
        return {**master, "iterations": str(tries), "tolerance": repr(tolerance)}


def _kind(type: str) -> str:
    """Returns the type of a parameter for a variable: "Real", "Integer", "Boolean" or "String"."""
    if type in ("Real", "Float32", "Float64"):
        return "Real"
    return type if type in ("Boolean", "String", "Binary") else "Integer"


def _value(type: str, text: str) -> Value | None:
    """Returns a start value as MasterSim reads it; None if it is none of this type."""
    kind = _kind(type)
    if kind == "Boolean":
        return {"true": True, "false": False}.get(text)
    if kind in ("String", "Binary"):
        return text
    number = double(text)
    if number is None or number != number or abs(number) > 1e308:
        return None
    if kind == "Real":
        return number
    return int(text) if re.fullmatch(r"[+-]?[0-9]+", text) else None
