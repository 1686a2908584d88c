"""Changes a system in its files: `swap` replaces the FMU of components and keeps every other byte.

Only the bytes of `source` attributes are changed: comments, layout, geometry and contents of other tools are preserved.
A system that `check` would refuse is never written.
"""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from filecmp import cmp
from pathlib import Path, PurePosixPath
from typing import Any, TypeAlias

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError, Where
from cosim_master.diagnostics.names import is_pattern, matching, near, near_pattern, similar
from cosim_master.files import archive
from cosim_master.files.whole import write_whole, writing
from cosim_master.fmi.description.read import FmuDescription, describe
from cosim_master.system import shipped
from cosim_master.system.authoring.fitting import companions, having, lacking, misfits, model_fmu, models, own_start
from cosim_master.system.authoring.text.sources import references
from cosim_master.system.flatten.check import check
from cosim_master.system.flatten.flat import CheckedSystem
from cosim_master.system.reading.read import FMU_TYPE, ROOT_DOCUMENT, SSP_TYPE, read_system
from cosim_master.system.structure import Component, Element, System, SystemStructure

__all__ = ["documents", "rebased", "swap"]


def swap(
    system: str | Path,
    component: str,
    fmu: str | Path,
    out: str | Path | None = None,
    note: Callable[[str], None] | None = None,
) -> Path:
    """Replaces the FMU of one component of a system, or of all that a pattern matches.

    If another component of the same system does not accept the values that the new FMU declares for its outputs
    (`cosim.verdict.Values`), it is swapped, too, for an FMU that does: the autopilot for a vehicle.

    An .ssd that other components also use is copied, once for all components with the same change, and only their
    references are redirected. If all its users change, the .ssd itself is changed. Sources that lead out of the
    system's folder are rewritten to refer to the same files from the new place.

    Args:
        system: .ssd, .ssp or folder.
        component: hierarchical name of the component ("drone3.vehicle"), or a pattern of such names ("drone*.vehicle").
        fmu: the new FMU, a file or the name of a model, whose FMU is searched in the folder `fmus` and then among those
            of this project; an .ssp stores a copy of it in resources/.
        out: the new system: an .ssp or a folder, which must not exist. None changes `system` itself.
        note: called with a sentence for each other component that is swapped, or that does not accept the new FMU and
            stays, because there is no FMU that does; and for a model that two folders have.

    Returns:
        The path written: `out`, or `system`.

    Raises:
        SystemDescriptionError: the system is invalid, the component does not exist, or the FMU does not match its
            connectors and parameters; all mismatches are reported at once, but of an FMU that lacks many connectors
            only these. Then nothing has been written.
        WriteFailed: `out`, or a file of the system that is changed in place, cannot be written.
    """
    with read_system(system) as structure:
        chains = _chains(structure, component)
        path, notes = Path(fmu), list[str]()
        if not path.is_file():
            found = model_fmu(str(fmu))
            if found is None:
                close = similar(str(fmu), models())
                hint = near(str(fmu), close) if close else "give the FMU that the component is to have"
                raise _refusal(str(path), f"no such file; {hint}")
            path = found
            other = shipped.fmus() / path.name
            if other.is_file() and not cmp(other, path, shallow=False):
                notes.append(
                    f"{fmu} is {path}, not the model of this name that comes with uav-cosim; give {other} for it"
                )
        if out is None and not Path(system).exists():
            raise _refusal(str(system), "a shipped system is not changed in place; give a path for the new one")
        path = path.parent.resolve() / path.name
        kept = _check_fit(structure, chains, path)
        target = Path(system) if out is None else Path(out)
        if out is not None and target.exists():
            raise _refusal(str(target), "exists already; give a path that does not")
        others, unfit = _companions(structure, chains, path)
        edition = _Edition(structure, chains, path, target, in_place=out is None)
        edition.write()
    for name, (other, _) in others.items():
        swap(target, name, other)
    if note is not None:
        now = [f"{name} is now {other.stem}: {reason}" for name, (other, reason) in others.items()]
        for text in (*notes, *kept, *now, *unfit):
            note(text)
    return target


def _companions(
    structure: SystemStructure, chains: Sequence[Sequence[Element]], fmu: Path
) -> tuple[dict[str, tuple[Path, str]], list[str]]:
    """Returns the FMUs that other components need so that they fit the new one, and the reasons, by component.

    The second is a sentence for each component that does not fit and for which no FMU is found.
    """
    found: dict[str, tuple[Path, str]] = {}
    unfit: list[str] = []
    known: dict[Path, FmuDescription | None] = {}
    for chain in chains:
        parent = _inside(chain[-2]) if len(chain) > 1 else structure.system
        new = chain[-1].name
        if parent is None:
            continue
        sources = {one.name: one.source for one in parent.elements if isinstance(one, Component) and _is_fmu(one)}
        fmus = {}
        for name, source in {**sources, new: fmu}.items():
            if source is not None and source not in known:
                known[source] = _described(source)
            if source is not None and (one := known[source]) is not None:
                fmus[name] = one
        head = [element.name for element in chain[:-1]]
        others = companions(parent, fmus, [new], (fmu.parent, shipped.fmus()))
        for name, one in others.items():
            reason = f"{fmus[name].path.stem} does not accept {fmu.stem}"
            found[".".join([*head, name])] = one.path, reason
        fitted = {**fmus, **others}
        for user, _, _, origin in misfits(parent, fitted):
            if new in (user, origin):
                name, body = ".".join([*head, user]), fitted[origin].path.stem
                unfit.append(f"{name} does not accept {body}, and no FMU that does is found")
    return found, unfit


def _described(file: Path) -> FmuDescription | None:
    """Returns the description of an FMU, None if it cannot be read (which `check` reports)."""
    try:
        return describe(file)
    except SystemDescriptionError:
        return None


def _refusal(shown: str, message: str) -> SystemDescriptionError:
    return SystemDescriptionError([Problem(Where(shown), message)])


def _inside(element: Element) -> System | None:
    if isinstance(element, System):
        return element
    return element.content if isinstance(element, Component) else None


def _walk(system: System, name: str, chain: tuple[Element, ...]) -> Iterator[tuple[str, tuple[Element, ...]]]:
    for element in system.elements:
        full = f"{name}.{element.name}" if name else element.name
        inner = (*chain, element)
        yield full, inner
        content = _inside(element)
        if content is not None:
            yield from _walk(content, full, inner)


def _chains(structure: SystemStructure, component: str) -> list[tuple[Element, ...]]:
    """Returns the elements from the root system (excluded) to each component (included) that a pattern means."""
    everything = list(_walk(structure.system, "", ()))
    fmus = {name: chain for name, chain in everything if isinstance(chain[-1], Component) and _is_fmu(chain[-1])}
    names = [component]
    if is_pattern(component) and all(name != component for name, _ in everything):
        names = matching(component, fmus)
        if not names:
            text = f'"{component}" matches no component that is an FMU; {near_pattern(component, fmus)}'
            raise _refusal(str(structure.path), text)
    by_name: dict[str, list[tuple[Element, ...]]] = {}
    for name, chain in everything:
        by_name.setdefault(name, []).append(chain)
    return [_chain(structure, name, by_name.get(name, []), fmus) for name in names]


def _chain(
    structure: SystemStructure,
    component: str,
    found: Sequence[tuple[Element, ...]],
    fmus: Mapping[str, tuple[Element, ...]],
) -> tuple[Element, ...]:
    """Returns the only element found under a name, if it is an FMU that can be swapped."""
    if not found:
        raise _refusal(str(structure.path), f'there is no component "{component}"; {near(component, fmus)}')
    if len(found) > 1:
        raise _refusal(str(structure.path), f'"{component}" names {len(found)} elements; rename all but one')
    (chain,) = found
    if not (isinstance(chain[-1], Component) and _is_fmu(chain[-1])):
        if isinstance(chain[-1], Component) and chain[-1].content is None and chain[-1].source is not None:
            text = f'"{component}" is the file {chain[-1].source.name}, not an FMU; change its source in the .ssd'
            raise _refusal(str(structure.path), f"{text}; {near(component, fmus)}")
        inner = [name for name in fmus if name.startswith(component + ".")]
        raise _refusal(str(structure.path), f'"{component}" is a system, not an FMU; {near(component, inner)}')
    shared = [element for element in chain if isinstance(element, Component) and element.type != SSP_TYPE]
    for element in shared:
        if element.fragment is not None:
            text = f'"{component}" is inside "#{element.fragment}", which other components share'
            raise SystemDescriptionError([Problem(element.where, text)])
    packed = [element for element in chain if isinstance(element, Component) and element.type == SSP_TYPE]
    if packed:
        text = f'"{component}" is inside the archive of "{packed[0].name}"; unpack it to a folder to change it'
        raise SystemDescriptionError([Problem(packed[0].where, text)])
    return chain


def _is_fmu(component: Component) -> bool:
    return component.content is None and component.type == FMU_TYPE


_FEW = 3
"""Number of missing connectors that are named one by one, each with its line."""


def _check_kind(chains: Sequence[Sequence[Element]], fmu: Path) -> None:
    """Refuses an FMU of another kind, which lacks most of the connectors, in one sentence for each component."""
    if (new := _described(fmu)) is None:
        return
    problems: list[Problem] = []
    for element in (chain[-1] for chain in chains):
        if not isinstance(element, Component) or len(names := lacking(new, element.connectors)) <= _FEW:
            continue
        arrays = ", ".join(dict.fromkeys(name.partition("[")[0] for name in names))
        text = f"{fmu.name} lacks {len(names)} of the {len(element.connectors)} connectors of this component: {arrays}"
        if others := having(element.connectors, (fmu.parent, shipped.fmus())):
            text += f"; FMUs that have all: {', '.join(others)}"
        problems.append(Problem(element.where, text))
    if problems:
        raise SystemDescriptionError(dict.fromkeys(problems))


def _check_fit(structure: SystemStructure, chains: Sequence[Sequence[Element]], fmu: Path) -> list[str]:
    """Checks the changed system. Here, a parameter that the new FMU lacks is a mismatch, not a note.

    Returns:
        Notes on values that the system sets, where the two FMUs have different ones of their own.
    """
    _check_kind(chains, fmu)
    gone = {one[-1].where for one in chains if isinstance(one[-1], Component) and one[-1].source is None}
    # The old FMU may be swapped because it is missing.
    problems = [
        problem
        for problem in structure.problems
        if not (problem.where in gone and problem.message.startswith("source "))
    ]
    targets = {tuple(element.name for element in chain) for chain in chains}
    system = _exchanged(structure.system, (), targets, fmu)
    checked = check(replace(structure, system=system, problems=tuple(problems)))
    heads = tuple(".".join(target) + "." for target in targets)
    lost = [item for item in checked.unmatched if item.name.startswith(heads)]
    if lost:
        problems = [Problem(item.where, f'{fmu.name} has no parameter for "{item.name}"; {item.hint}') for item in lost]
        raise SystemDescriptionError([*problems, *_written_anew(structure, chains, fmu)])
    return [*_kept(checked, chains, fmu)]


_OPTIONS = ("vehicle", "autopilot", "agent")
"""The parts of drones that `new` has options for."""


def _written_anew(structure: SystemStructure, chains: Sequence[Sequence[Element]], fmu: Path) -> Iterator[Problem]:
    """Yields the remedy for values that an FMU in a part of drones lacks."""
    names = {(len(chain), chain[-1].name) for chain in chains}
    drones = sum(_inside(one) is not None for one in structure.system.elements)
    for length, part in names:
        if length == 2 and part in _OPTIONS and len(names) == 1:
            command = f"uav-cosim new {structure.path} --drones {drones} --{part} {fmu} -o FOLDER"
            text = f"take these values out of the system, or write a new one, which leaves them out: {command}"
            yield Problem(Where(str(structure.path)), text)


def _kept(checked: CheckedSystem, chains: Sequence[Sequence[Element]], fmu: Path) -> Iterator[str]:
    """Yields notes on values for the old FMU, one for each parameter, which the new one would have otherwise."""
    new, olds, told = _described(fmu), dict[Path, FmuDescription | None](), set[str]()
    for chain in chains:
        source, instance = getattr(chain[-1], "source", None), ".".join(element.name for element in chain)
        if new is None or source is None:
            continue
        if source not in olds:
            olds[source] = _described(source)
        if (old := olds[source]) is None:
            continue
        for (owner, name), made in checked.assignments.items():
            if owner != instance or name in told:
                continue
            if (own := own_start(name, made[-1].value, old, new)) is not None:
                told.add(name)
                yield f"{instance}.{name} stays {made[-1].text}, as {made[-1].where} has it; {fmu.name} alone has {own}"


def _exchanged(system: System, path: tuple[str, ...], targets: set[tuple[str, ...]], fmu: Path) -> System:
    """Returns the system, with another FMU in the components at these paths."""
    heads = {target[: len(path) + 1] for target in targets}
    elements: list[Element] = []
    for element in system.elements:
        here = (*path, element.name)
        inside = _inside(element) if here in heads else None
        if here in targets and isinstance(element, Component):
            elements.append(replace(element, source=fmu))
        elif inside is None:
            elements.append(element)
        else:
            grown = _exchanged(inside, here, {target for target in targets if target[: len(here)] == here}, fmu)
            elements.append(replace(element, content=grown) if isinstance(element, Component) else grown)
    return replace(system, elements=tuple(elements))


def documents(structure: SystemStructure) -> Iterator[Path]:
    """Returns the .ssd files of a system: its root, those of components, and the variants in the folder of the root."""
    yield structure.document
    if structure.path.suffix.lower() != ".ssd":
        yield from structure.document.parent.glob("*.ssd")
    for _, chain in _walk(structure.system, "", ()):
        element = chain[-1]
        packed = any(isinstance(outer, Component) and outer.type == SSP_TYPE for outer in chain)
        if not packed and isinstance(element, Component) and element.content is not None:
            yield element.content.document


def rebased(data: bytes, old: Path, new: Path, base: Path) -> bytes:
    """Returns a document that moves from `old` to `new` with its folder `base`.

    Sources that lead out of `base` are rewritten to refer to the same files."""
    pieces, at = [], 0
    for reference in references(data, old, str(old)):
        if reference.target is None or reference.target.is_relative_to(base):
            continue
        written = reference.written(os.path.relpath(reference.target, new.parent))
        pieces += [data[at : reference.start], written]
        at = reference.stop
    return b"".join([*pieces, data[at:]])


_Change: TypeAlias = tuple[tuple[tuple[str, ...], Path | None, Any], ...]
"""The changes of a document: names that lead to a component, and the document and the change of this component, or None
and no change for a component with the new FMU. Components with the same changes share a document.
"""


class _Edition:
    """A changed system: its files, and the contents of those that change."""

    def __init__(
        self,
        structure: SystemStructure,
        chains: Sequence[Sequence[Element]],
        fmu: Path,
        target: Path,
        *,
        in_place: bool,
    ) -> None:
        self.structure = structure
        self.fmu = fmu
        self.in_place = in_place
        self.target = target
        self.base = structure.document.parent
        self.packing = target.suffix.lower() == ".ssp"
        self.root = self.base if in_place and not self.packing else target.parent.resolve() / target.name
        self.files: dict[PurePosixPath, Path | bytes] = {}
        """Content by path in the new system: a file to copy, or the bytes themselves."""
        self.places: dict[Path, PurePosixPath] = {}
        """Places in the new system for files of the old one."""
        self.documents = set(documents(structure))
        """The documents that may have to change, except those in nested archives, which never change."""
        self.done: set[tuple[Path, tuple[str, ...]]] = set()
        """The components whose source has been written, by document and names."""
        self.targets = {tuple(element.name for element in chain) for chain in chains}
        self.uses: dict[Path, dict[_Change, str]] = {}
        """The changes of each document for the components that refer to it, and the first component for each change."""
        self._take_over()
        self._rewrite()

    def _relative(self, path: Path) -> PurePosixPath | None:
        return PurePosixPath(path.relative_to(self.base).as_posix()) if path.is_relative_to(self.base) else None

    def _take_over(self) -> None:
        """Adds the files of the old system to the new one, unchanged at first."""
        given = self.structure.path
        if given.is_dir() or given.suffix.lower() == ".ssp":
            members = [path for path in sorted(self.base.rglob("*")) if path.is_file()]
        else:
            members = sorted(path for path in self._reachable() if self._relative(path) is not None)
        for path in members:
            relative = self._relative(path)
            if relative is None or (path.resolve().is_relative_to(self.root) and not self.in_place):
                continue
            if path == self.structure.document and not self.in_place:
                relative = PurePosixPath(ROOT_DOCUMENT)
            self.files[relative] = path
            self.places[path] = relative

    def _reachable(self) -> set[Path]:
        """Returns the documents of the system and every existing file that they refer to."""
        found = set(self.documents)
        for document in self.documents:
            found_here = references(document.read_bytes(), document, str(document))
            targets = (reference.target for reference in found_here)
            found.update(target for target in targets if target is not None and target.is_file())
        return found

    def _rewrite(self) -> None:
        root = self.structure.document
        change = self._change(self.structure.system, (), ())
        placed: dict[tuple[Path, _Change], PurePosixPath] = {(root, change): self.places[root]}
        own = {root: change}
        copies: list[tuple[Path, _Change, PurePosixPath]] = []
        for document, wanted in self.uses.items():
            changes = [one for one in wanted if one]
            if changes and () not in wanted and document in self.places and document not in own:
                own[document] = changes.pop(0)
                placed[document, own[document]] = self.places[document]
            for one in changes:
                place = self._copy_name(document, wanted[one])
                self.files[place] = document  # reserves the name
                placed[document, one] = place
                copies.append((document, one, place))
        for document in [path for path in self.places if path in self.documents]:
            if not self.in_place or self.packing or own.get(document):
                redirected = self._redirected(own.get(document, ()), placed)
                self._place_document(document, self.places[document], redirected)
        for document, one, place in copies:
            self._place_document(document, place, self._redirected(one, placed))
        asked = {(document, names) for document, one in placed for names, _, _ in one}
        for document, _ in sorted(asked - self.done):
            raise _refusal(str(document), "has a source that cannot be found to be changed")

    def _change(self, system: System, path: tuple[str, ...], names: tuple[str, ...]) -> _Change:
        """Returns the change of the document that contains `system`; `uses` gets those of referenced documents."""
        found: list[tuple[tuple[str, ...], Path | None, Any]] = []
        for element in system.elements:
            here, inner = (*path, element.name), (*names, element.name)
            if isinstance(element, System):
                found += self._change(element, here, inner)
            elif here in self.targets:
                found.append((inner, None, ()))
            elif isinstance(element, Component) and element.content is not None and element.type != SSP_TYPE:
                document = element.content.document
                change = self._change(element.content, here, ())
                first = next((target for target in sorted(self.targets) if target[: len(here)] == here), here)
                self.uses.setdefault(document, {}).setdefault(change, ".".join(first[:-1]))
                if change:
                    found.append((inner, document, change))
        return tuple(found)

    def _redirected(
        self, change: _Change, placed: Mapping[tuple[Path, _Change], PurePosixPath]
    ) -> dict[tuple[str, ...], PurePosixPath | Path]:
        """Returns the new targets of the sources that a change affects, by the names that lead to them."""
        fmu = self._packed(self.fmu) if self.packing else self.fmu
        return {names: fmu if inner is None else placed[inner, deeper] for names, inner, deeper in change}

    def _copy_name(self, document: Path, owner: str) -> PurePosixPath:
        relative = self._relative(document)
        folder = PurePosixPath() if relative is None else relative.parent
        stem = f"{document.stem}-{re.sub(r'[^A-Za-z0-9_.-]', '_', owner)}"
        return self._free(folder, stem, document.suffix)

    def _free(self, folder: PurePosixPath, stem: str, suffix: str) -> PurePosixPath:
        candidate, number = folder / f"{stem}{suffix}", 1
        while candidate in self.files or (self.in_place and not self.packing and (self.base / candidate).exists()):
            number += 1
            candidate = folder / f"{stem}-{number}{suffix}"
        return candidate

    def _packed(self, path: Path) -> PurePosixPath:
        """Returns the place of an external file in the archive; it is added on first use."""
        if path not in self.places:
            folder = PurePosixPath("resources")
            same = folder / path.name
            content = self.files.get(same)
            if isinstance(content, Path) and content.read_bytes() == path.read_bytes():
                self.places[path] = same
                return same
            place = self._free(folder, path.stem, path.suffix)
            self.files[place], self.places[path] = path, place
            if path in self.documents:
                self._place_document(path, place, {})
        return self.places[path]

    def _place_document(
        self,
        document: Path,
        place: PurePosixPath,
        redirected: Mapping[tuple[str, ...], PurePosixPath | Path],
    ) -> None:
        """Adds a document to the new system, with its sources redirected as needed."""
        data = document.read_bytes()
        folder = self.root / place.parent
        pieces, at = [], 0
        for reference in references(data, document, str(document)):
            old, wanted = reference.target, None
            if reference.elements:
                wanted = redirected.get(reference.elements)
                self.done.add((document, reference.elements))
            if wanted is None:
                if old is None:
                    continue
                wanted = self.places.get(old, old)
                if self.packing and isinstance(wanted, Path) and wanted.is_file():
                    wanted = self._packed(wanted)
            location = self.root / wanted
            if old is not None and location == Path(os.path.normpath(folder / os.path.relpath(old, document.parent))):
                continue
            if reference.fragment and wanted in redirected.values():
                reference = replace(reference, fragment="")
            pieces += [data[at : reference.start], reference.written(os.path.relpath(location, folder))]
            at = reference.stop
        self.files[place] = b"".join([*pieces, data[at:]]) if pieces else document
        self.places.setdefault(document, place)

    def write(self) -> None:
        """Writes the new system to a temporary place first, so that a failure leaves no half-written files."""
        with writing(self.root):
            if self.in_place and not self.packing:
                self._write_changed()
            else:
                self._write_new()

    def _write_new(self) -> None:
        self.root.parent.mkdir(parents=True, exist_ok=True)
        part = self.root.with_name(self.root.name + ".part")
        shutil.rmtree(part, ignore_errors=True)
        try:
            for place, content in self.files.items():
                path = part / place
                path.parent.mkdir(parents=True, exist_ok=True)
                if isinstance(content, bytes):
                    path.write_bytes(content)
                else:
                    shutil.copyfile(content, path)
            if self.packing:
                members = {str(place): part / place for place in self.files}
                archive.pack(members, part / "packed.ssp")
                (part / "packed.ssp").replace(self.root)
            else:
                part.replace(self.root)
        finally:
            shutil.rmtree(part, ignore_errors=True)

    def _write_changed(self) -> None:
        # Copies are written first: the document that refers to them is replaced last, when all files exist.
        changed = [
            (self.base / place, content if isinstance(content, bytes) else content.read_bytes())
            for place, content in self.files.items()
            if content != self.base / place
        ]
        for path, content in sorted(changed, key=lambda item: item[0].exists()):
            write_whole(path, content)
