"""Wrong multi-models on purpose: whatever a JSON file holds, only our own errors come out, each within a second.

    python -m tests.master.fuzz.multimodel_fuzz [--inputs 100000] [--seed 1] [--keep FOLDER]

An input is a multi-model, or the configuration of a run with one, that is right, and then changed: values anywhere in
its tree become others (of other types, too long, too large, half a character), keys get lost, are given twice or
another's, parts are copied to other places, text is nested deeply, bytes are mutated. Input number i of a seed is
always the same.
"""

from __future__ import annotations

import copy
import json
import random
import shutil
import tempfile
from collections import Counter
from pathlib import Path
from typing import Any

from cosim_master.system.reading.others.into_cps import read_multimodel
from tests.master.fuzz.ssp_fuzz import Finding, attempt, command, described_once, make_fmus, mutated_bytes

A, B = "{A}.one", "{B}.two"
TEXTS = (
    *("", ".", "..", "/", "{", "}", "{}", "{A}", "{A}.", "{A}.one", "{A}.one.", "{A}.one.y", "{B}.two.u", "{C}.x.y"),
    *("{A}.one.y.y", "{A}.one.p", "{A}{B}.x.u", "{A}.o.ne.y", "a.b.c", "probe.fmu", "three.fmu", "../probe.fmu"),
    *(
        "file:///etc/passwd",
        "file:probe.fmu",
        "file:///%00",
        "http://example.org/a.fmu",
        "C:\\x\\probe.fmu",
        "//h/x.fmu",
    ),
    *("resources/probe.fmu", "mm.json", "coe.json", "./mm.json", "fixed-step", "var-step", "\0", "\ud800", "\udfff x"),
    *("é", "\u2028", "\x1b[31m", "x" * 5000, "/" * 5000, "{A}." * 300, "%s%n", "{0}", "NaN", "1e999", "true", "high"),
)
NUMBERS = (0, 1, -1, 5, 0.25, -0.0, 1e-300, 1e300, 2**31, -(2**31) - 1, 2**53 + 1, 10**400, 1e-9, 3.5)
KEYS = (
    *("fmus", "connections", "parameters", "algorithm", "size", "type", "startTime", "endTime", "multimodel_path"),
    *("stabalizationEnabled", "modelSwaps", "modelTransfers", "faultInjectInstances", "faultInjectConfigurationPath"),
    *(
        "livestream",
        "logVariables",
        "visible",
        "loggingOn",
        "overrideLogLevel",
        "{A}",
        "{B}",
        "{D}",
        f"{A}.y",
        f"{B}.u",
    ),
)


def seeds() -> tuple[dict[str, Any], ...]:
    """Files by name; what is read is "coe.json" where there is one, else "mm.json"."""
    model = {
        "fmus": {"{A}": "probe.fmu", "{B}": "resources/probe.fmu", "{T}": "three.fmu"},
        "connections": {
            f"{A}.y": [f"{B}.u", "{A}.other.u"],
            f"{B}.m": [f"{A}.n"],
            f"{B}.r": [f"{A}.s"],
            f"{A}.f": [f"{B}.e"],
            "{T}.t.f64_out[1]": ["{T}.t.f64_in[2]"],
        },
        "parameters": {f"{A}.p": 2, f"{B}.p": 0.5, f"{A}.mode": 0, f"{A}.b": True, f"{B}.s": "x", "{T}.t.i8_in[1]": 3},
    }
    how = {"algorithm": {"type": "fixed-step", "size": 0.25}, "startTime": 0, "endTime": 3.0}
    shown = {
        "livestream": {A: ["y"]},
        "logVariables": {},
        "visible": False,
        "loggingOn": True,
        "overrideLogLevel": None,
    }
    return (
        {"mm.json": {**model, **how, **shown}},
        {"mm.json": {**how, **model}},
        {"mm.json": model, "run/coe.json": {**how, **shown}},
        {"mm.json": model, "coe.json": {**how, "multimodel_path": "mm.json"}},
        {"mm.json": model, "coe.json": {**how, "multimodel_path": "models/mm.json"}},
    )


def _value(choose: random.Random, depth: int = 0) -> Any:
    kind = choose.randrange(9 if depth < 3 else 6)
    if kind < 2:
        return choose.choice(TEXTS)
    if kind == 2:
        return choose.choice(NUMBERS)
    if kind < 6:
        return choose.choice((None, True, False, [], {}, choose.random() * 10 ** choose.randint(-12, 12)))
    if kind == 6:
        return [_value(choose, depth + 1) for _ in range(choose.choice((1, 2, 3, 60)))]
    return {_key(choose): _value(choose, depth + 1) for _ in range(choose.choice((1, 2, 3, 20)))}


def _key(choose: random.Random) -> str:
    return choose.choice(KEYS if choose.random() < 0.6 else TEXTS)


def _places(content: Any) -> list[tuple[Any, Any]]:
    """Every container of a tree with each of its keys or indices."""
    found: list[tuple[Any, Any]] = []
    if isinstance(content, dict | list):
        for key in list(content) if isinstance(content, dict) else range(len(content)):
            found.append((content, key))
            found += _places(content[key])
    return found


def _tree(content: dict[str, Any], choose: random.Random) -> None:
    """One change to a tree."""
    places = _places(content)
    if not places:
        content[_key(choose)] = _value(choose)
        return
    holder, key = choose.choice(places)
    kind = choose.randrange(7)
    if kind < 2:
        holder[key] = _value(choose)
    elif kind == 2:
        del holder[key]
    elif kind == 3 and isinstance(holder, dict):
        holder[_key(choose)] = holder.pop(key)
    elif kind == 4:
        other, source = choose.choice(places)
        holder[key] = copy.deepcopy(other[source])
    elif isinstance(holder, dict):
        holder[_key(choose)] = _value(choose)
    else:
        holder.insert(choose.randrange(len(holder) + 1), _value(choose))


def _text(content: Any, choose: random.Random) -> str:
    """As JSON, now and then with a key that is there twice, numbers that JSON has not, or without an end."""
    text = json.dumps(content, indent=choose.choice((None, 1)), ensure_ascii=choose.random() < 0.8)
    kind = choose.random()
    if kind < 0.05:
        text = text.replace("{B}", "{A}")
    elif kind < 0.08:
        text = text.replace("0.25", choose.choice(("NaN", "Infinity", "-Infinity", "1e9999", "9" * 5000, "00", "0x1")))
    elif kind < 0.10:
        at = choose.randrange(len(text) + 1)
        text = text[:at] + choose.choice(("[", "{", '{"a":', '"')) * choose.choice((1, 100, 50_000)) + text[at:]
    return text


def write_input(folder: Path, seed: int, number: int) -> Path:
    """Write input `number` into `folder` (which has the FMUs); returns what to read."""
    choose = random.Random(f"{seed} {number}")
    files = copy.deepcopy(choose.choice(seeds()))
    for _ in range(choose.choice((0, 1, 1, 2, 4, 12))):
        _tree(files[choose.choice(sorted(files))], choose)
    kind = choose.random()
    whole: Any = _value(choose) if kind < 0.05 else None
    for name, content in files.items():
        data = _text(whole if kind < 0.05 else content, choose).encode("utf-8", "surrogatepass")
        if kind > 0.7:
            data = mutated_bytes(data, choose)
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(data)
    return folder / ("coe.json" if "coe.json" in files else "mm.json")


def fuzz(inputs: int, seed: int, keep: Path | None = None, first: int = 0) -> tuple[Counter[str], float, list[Finding]]:
    """Try inputs; returns how they ended, the longest processor time, and the findings."""
    counts: Counter[str] = Counter()
    longest, findings = 0.0, []
    with tempfile.TemporaryDirectory(prefix="fuzz-") as root, described_once():
        fmus = Path(root) / "fmus"
        make_fmus(fmus)
        for number in range(first, first + inputs):
            folder = Path(root) / "work"
            (folder / "resources").mkdir(parents=True)
            for name in ("probe.fmu", "three.fmu", "resources/probe.fmu"):
                (folder / name).symlink_to(fmus / Path(name).name)
            outcome, spent, finding = attempt(write_input(folder, seed, number), number, read_multimodel)
            counts[outcome] += 1
            longest = max(longest, spent)
            if finding is not None:
                findings.append(finding)
                if keep is not None:
                    shutil.copytree(folder, keep / str(number), dirs_exist_ok=True)
            shutil.rmtree(folder)
    return counts, longest, findings


if __name__ == "__main__":
    command(__doc__, fuzz)
