"""ArduPilot's DataFlash logs (.bin): the definitions of messages, and their bytes.

A log is a sequence of messages without padding: 0xA3 0x95, the type, and the fields in little endian. FMT defines the
other types; UNIT, MULT and FMTU define units of fields, and factors to them.

Source: ArduPilot 4.5 to 4.7-dev, AP_Logger (LogStructure.h and those of the libraries), ArduCopter (Log.cpp).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

__all__ = ["MESSAGES", "Log", "Message", "texts"]

Column: TypeAlias = "np.ndarray[Any, Any] | float | bytes"

_HEAD = b"\xa3\x95"
_TYPES = {
    "b": "i1", "B": "u1", "M": "u1", "h": "<i2", "H": "<u2", "c": "<i2", "C": "<u2", "i": "<i4", "I": "<u4",
    "e": "<i4", "E": "<u4", "L": "<i4", "f": "<f4", "d": "<f8", "q": "<i8", "Q": "<u8", "n": "S4", "N": "S16",
    "Z": "S64",
}  # fmt: skip
_HUNDREDTHS = "cCeE"


@dataclass(frozen=True, slots=True)
class Message:
    """The definition of a message.

    Attributes:
        name: up to 4 characters.
        format: the type of each field.
        labels: the names of the fields, separated by commas.
        units: the unit of each field, by `UNITS`.
        factors: of each field to its unit, by `FACTORS`.
    """

    name: str
    format: str
    labels: str
    units: str
    factors: str

    @property
    def record(self) -> np.dtype[np.void]:
        """The type of a whole message."""
        fields = zip(self.labels.split(","), self.format, strict=True)
        return np.dtype([("head", "S2"), ("type", "u1"), *((name, _TYPES[code]) for name, code in fields)])


_AXES = ("N", "E", "D")
_PSC = ("TP", "P", "DV", "TV", "V", "DA", "TA", "A")


def _position_control(axis: str) -> Message:
    labels = ",".join(["TimeUS", *(f"{one}{axis}" for one in _PSC)])
    return Message(f"PSC{axis}", "Qffffffff", labels, "smmnnnooo", "F00000000")


_CHANNELS = ",".join(f"C{i}" for i in range(1, 15))
_DEFINED = (
    Message("FMT", "BBnNZ", "Type,Length,Name,Format,Columns", "-b---", "-----"),
    Message("UNIT", "QbZ", "TimeUS,Id,Label", "s--", "F--"),
    Message("FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds", "s---", "F---"),
    Message("MULT", "Qbd", "TimeUS,Id,Mult", "s--", "F--"),
    Message("PARM", "QNff", "TimeUS,Name,Value,Default", "s---", "F---"),
    Message("MSG", "QZ", "TimeUS,Message", "s-", "F-"),
    Message("ORGN", "QBLLe", "TimeUS,Type,Lat,Lng,Alt", "s-DUm", "F-GGB"),
    Message("MODE", "QMBB", "TimeUS,Mode,ModeNum,Rsn", "s---", "F---"),
    Message("EV", "QB", "TimeUS,Id", "s-", "F-"),
    Message("ERR", "QBB", "TimeUS,Subsys,ECode", "s--", "F--"),
    Message("ATT", "QffffffB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,AEKF", "sddddhh-", "F000000-"),
    Message(
        "RATE", "Qffffffffffff", "TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y,YOut,ADes,A,AOut", "skk-kk-kk-oo-",
        "F00-00-00-BB-",
    ),
    Message("POS", "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt", "sDUmmm", "FGG000"),
    *map(_position_control, _AXES),
    Message(
        "CTUN", "Qffffffefffhh", "TimeUS,ThI,ABst,ThO,ThH,DAlt,Alt,BAlt,DSAlt,SAlt,TAlt,DCRt,CRt", "s----mmmmmmnn",
        "F----00B000BB",
    ),
    Message("RCOU", "QHHHHHHHHHHHHHH", f"TimeUS,{_CHANNELS}", "sYYYYYYYYYYYYYY", "F--------------"),
    Message(
        "BAT", "QBfffffcfB", "TimeUS,Inst,Volt,VoltR,Curr,CurrTot,EnrgTot,Temp,Res,RemPct", "s#vvAaXOw%",
        "F-000C0?00",
    ),
    Message(
        "GPS", "QBBIHBcLLeffffB", "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U",
        "s#-s-S-DUmnhnh-", "F--C-0BGGB000--",
    ),
    Message(
        "IMU", "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz", "s#EEEooo--O--zz",
        "F-000000-----00",
    ),
    Message(
        "ATUN", "QBBfffffff", "TimeUS,Axis,TuneStep,Targ,Min,Max,RP,RD,SP,ddt", "s--ddd---o", "F--000---0",
    ),
    Message("ATDE", "Qff", "TimeUS,Angle,Rate", "sdk", "F00"),
    Message(
        "XKF1", "QBccCfffffffccce", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH",
        "s#ddhnnnnmmmkkkm", "F-BBB0000000BBBB",
    ),
)  # fmt: skip
MESSAGES = {one.name: one for one in _DEFINED}
_NUMBERS = {one.name: 128 + i for i, one in enumerate(_DEFINED)}

UNITS = {
    "-": "", "?": "UNKNOWN", "A": "A", "a": "Ah", "b": "B", "d": "deg", "D": "deglatitude", "E": "rad/s",
    "h": "degheading", "k": "deg/s", "m": "m", "n": "m/s", "o": "m/s/s", "O": "degC", "%": "%", "S": "satellites",
    "s": "s", "U": "deglongitude", "v": "V", "w": "Ohm", "X": "W.h", "Y": "us", "z": "Hz", "#": "instance",
}  # fmt: skip
FACTORS = {"-": 0.0, "?": 1.0, "0": 1.0, "B": 1e-2, "C": 1e-3, "F": 1e-6, "G": 1e-7}


class Log:
    """A log in the making: messages are added in any order and written in that of their times."""

    def __init__(self) -> None:
        self._pieces: list[tuple[np.ndarray[Any, np.dtype[np.int64]], bytes, int]] = []

    def add(self, name: str, time: np.ndarray[Any, np.dtype[np.float64]], *fields: Column) -> None:
        """Adds messages of one type.

        Args:
            name: of the message.
            time: (n,) s since the beginning.
            fields: after TimeUS; each (n,) values in the unit of the field's type (degrees for L, hundredths have
                their point), or one for all. Numbers beyond the range of a type become its nearest value.
        """
        kind = MESSAGES[name]
        rows = np.zeros(len(time), kind.record)
        stamps = np.rint(time * 1e6).astype(np.int64)
        rows["head"], rows["type"], rows["TimeUS"] = _HEAD, _NUMBERS[name], stamps
        for label, code, values in zip(kind.labels.split(",")[1:], kind.format[1:], fields, strict=True):
            rows[label] = _stored(code, values)
        self._pieces.append((stamps, rows.tobytes(), kind.record.itemsize))

    def write(self) -> Iterator[bytes]:
        """Returns the bytes of the log, in pieces."""
        yield _definitions()
        stamps = np.concatenate([one for one, _, _ in self._pieces])
        of = np.repeat(np.arange(len(self._pieces)), [len(one) for one, _, _ in self._pieces])
        row = np.concatenate([np.arange(len(one)) for one, _, _ in self._pieces])
        for i in np.argsort(stamps, kind="stable").tolist():
            _, data, size = self._pieces[of[i]]
            at = int(row[i]) * size
            yield data[at : at + size]


def _stored(code: str, values: Column) -> Any:
    """Returns values as the type of a field stores them."""
    if code in "nNZ":
        return values
    numbers = np.asarray(values, dtype=np.float64)
    if code in "fd":
        return numbers
    scale = 100.0 if code in _HUNDREDTHS else 1e7 if code == "L" else 1.0
    kind = np.iinfo(_TYPES[code])
    return np.clip(np.rint(numbers * scale), kind.min, kind.max).astype(_TYPES[code])


def _packed(name: str, *fields: Any) -> bytes:
    kind = MESSAGES[name]
    record = np.zeros(1, kind.record)
    record[0] = (_HEAD, _NUMBERS[name], *fields)
    return record.tobytes()


def _definitions() -> bytes:
    """Returns FMT of all messages, then UNIT, MULT and FMTU."""
    written = [
        _packed("FMT", _NUMBERS[one.name], one.record.itemsize, one.name, one.format, one.labels) for one in _DEFINED
    ]
    written += [_packed("UNIT", 0, ord(code), unit) for code, unit in UNITS.items()]
    written += [_packed("MULT", 0, ord(code), factor) for code, factor in FACTORS.items()]
    written += [_packed("FMTU", 0, _NUMBERS[one.name], one.units, one.factors) for one in _DEFINED]
    return b"".join(written)


def texts(values: Sequence[str], size: int) -> np.ndarray[Any, Any]:
    """Returns texts as fields of `size` bytes; longer ones are cut."""
    return np.array([one.encode("utf-8")[:size] for one in values], dtype=f"S{size}")
