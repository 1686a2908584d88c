"""Writes starting points for new models and channels: documented files that work without changes.

The texts are templates of the models' package (`shipped.templates`); this module does not depend on their contents.
"""

from __future__ import annotations

import keyword
from pathlib import Path
from string import Template

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.files.whole import write_whole, writing
from cosim_master.system import shipped

__all__ = ["commands_of", "new_model"]


def new_model(kind: str, file: Path) -> str:
    """Writes a starting point of a kind ("agent") for a model named after the file: my_law.py contains MyLaw.

    Returns:
        The name of the model; of a channel, that of its file.

    Raises:
        SystemDescriptionError: the kind does not exist, the file exists, or its name is not that of a Python module.
        WriteFailed: the file cannot be written.
    """
    templates = shipped.templates()
    if kind not in templates:
        raise _refusal(kind, f"is not a kind of file; valid: {', '.join(templates)}")
    if file.suffix != ".py" or not file.stem.isidentifier() or keyword.iskeyword(file.stem):
        raise _refusal(str(file), "is not the name of a Python module: give one such as my_law.py")
    if not file.stem.isascii():
        raise _refusal(str(file), "names of models become C identifiers and must be ASCII: give one such as my_law.py")
    if file.exists():
        raise _refusal(str(file), "exists already")
    name = "".join(word[:1].upper() + word[1:] for word in file.stem.split("_"))
    text = Template(templates[kind].read_text(encoding="utf-8")).substitute(name=name, file=file.as_posix())
    with writing(file):
        write_whole(file, text.encode())
    return name if f"class {name}" in text else file.stem


def commands_of(file: Path) -> tuple[str, ...]:
    """Returns the commands in the docstring of a starting point, which use it."""
    lines = (line.strip() for line in file.read_text(encoding="utf-8").splitlines())
    return tuple(line for line in lines if line.startswith("uav-cosim "))


def _refusal(about: str, text: str) -> SystemDescriptionError:
    return SystemDescriptionError([Problem(Where(about), text)])
