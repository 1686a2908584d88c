"""Any C FMU of the tests, with faults at any of its functions: a wrapper around each, generated from their signatures.

The variable FAULT of the environment is "FAULT FUNCTION N", as the GUID of faulty.c: at call N of the function, the FMU
crashes (segv), overflows its stack (overflow), ends its process (exit, _exit, kill), does not return (sleep) or fills
its memory (memory); "once" is segv in one process only, which a file remembers. With "list", the functions that are
called are written to the file FAULT_CALLS.
"""

from __future__ import annotations

import re
from pathlib import Path

from tests.master.fmus.probe import compiled

_FUNCTIONS = Path(__file__).parents[3] / "master" / "cosim_master" / "fmi" / "isolation" / "functions.h"
_TYPES = {"P": "void *", "Z": "size_t ", "D": "double ", "I": "int ", "B": "bool "}
_STRIKE = """
static int deepened(int depth) {
    volatile char block[4096];
    block[0] = (char)depth;
    return deepened(depth + 1) + block[0];
}

static void strike(const char *function) {
    const char *fault = getenv("FAULT");
    char what[32], where[64];
    static int calls;
    int at;
    if (fault != NULL && !strcmp(fault, "list")) {
        FILE *file = fopen(getenv("FAULT_CALLS"), "a");
        fprintf(file, "%s\\n", function);
        fclose(file);
    }
    if (fault == NULL || sscanf(fault, "%31s %63s %d", what, where, &at) != 3 || strcmp(where, function)) return;
    if (++calls != at) return;
    if (!strcmp(what, "once")) {
        if (access("crashed", F_OK) == 0) return;
        fclose(fopen("crashed", "w"));
    }
    if (!strcmp(what, "segv") || !strcmp(what, "once")) *(volatile int *)8 = 1;
    if (!strcmp(what, "overflow")) calls = deepened(0);
    if (!strcmp(what, "exit")) exit(3);
    if (!strcmp(what, "_exit")) _exit(3);
    if (!strcmp(what, "kill")) kill(getpid(), SIGKILL);
    while (!strcmp(what, "sleep")) sleep(1);
    static void *volatile kept;
    while (!strcmp(what, "memory")) memset((void *)(kept = malloc(1 << 22)), 1, 1 << 22);
}
"""


def _signatures() -> dict[str, str]:
    """The shapes of the FMI functions in functions.h, by name."""
    text = _FUNCTIONS.read_text(encoding="utf-8")
    found = dict(re.findall(r"FUNCTION\((fmi[23]\w+), +([A-Z]+)", text))
    for kind in re.findall(r"GETS_AND_SETS3\((\w+), ", text):
        found |= {f"fmi3{verb}{kind}": "PZPZ" for verb in ("Set", "Get")}
    return {name: "" if shape == "NOTHING" else shape for name, shape in found.items() if shape != "INSTANTIATE"}


def faulting(source: Path, folder: Path) -> bytes:
    """The library of a C file whose functions of FMI are wrapped."""
    exported = re.findall(r"EXPORT \w+ \*?(fmi[23]\w+)\(", source.read_text(encoding="utf-8"))
    exported += re.findall(r"\bSTATES\(", source.read_text(encoding="utf-8")) and [
        f"fmi3{verb}FMUState" for verb in ("Get", "Set", "Free")
    ]
    chosen = {name: shape for name, shape in _signatures().items() if name in exported}
    lines = [f"#define {name} inner_{name}" for name in chosen]
    lines += [
        f'#include "{source}"',
        "#include <signal.h>",
        "#include <unistd.h>",
        *(f"#undef {name}" for name in chosen),
        _STRIKE,
    ]
    for name, shape in chosen.items():
        types = [_TYPES[letter] for letter in shape]
        given = "".join(f", {kind}a{n}" for n, kind in enumerate(types))
        passed = "".join(f", a{n}" for n in range(len(types)))
        kinds = "".join(f", {kind}" for kind in types)
        lines.append(f'EXPORT int {name}(void *h{given}) {{ strike("{name}"); ')
        lines.append(f"    return ((int (*)(void *{kinds}))inner_{name})(h{passed}); }}")
    file = folder / f"faulting_{source.stem}.c"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return compiled(file, folder, f"-I{source.parent}")
