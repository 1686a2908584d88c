"""A slice of the fuzzing of SSP's readers, and hypothesis on the parts that read text."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lxml import etree

from cosim_master.diagnostics.errors import Problem, SystemDescriptionError
from cosim_master.files.xml import Reader
from cosim_master.system.reading.read import read_system
from cosim_master.system.reading.ssp.references import read_reference
from cosim_master.system.reading.ssp.ssv import read_parameter_mapping, read_parameter_set, read_signal_dictionary
from tests.master.fuzz.ssp_fuzz import VALUES, fuzz

SSP1 = "http://ssp-standard.org/SSP1/SystemStructure"
ROOTS = {
    "ParameterValues": ("ParameterSet", read_parameter_set),
    "ParameterMapping": ("ParameterMapping", read_parameter_mapping),
    "SignalDictionary": ("SignalDictionary", read_signal_dictionary),
}


def test_a_slice_of_the_fuzzing() -> None:
    counts, _, findings = fuzz(400, seed=2)
    assert [finding for finding in findings if not finding.text.startswith("took ")] == []
    assert counts["accepted"] > 10 and counts["refused"] > 100


@pytest.mark.parametrize("kind", ROOTS)
@settings(max_examples=75, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_trees_of_known_words_in_any_order(kind: str, data: st.DataObject) -> None:
    """Readers of parameter sets, mappings and dictionaries take any tree of the standard's words, and only report."""
    names = ["Parameters", "Parameter", "MappingEntry", "DictionaryEntry", "Real", "Enumeration", "Binary", "Value"]
    shared = ["LinearTransformation", "IntegerMappingTransformation", "MapEntry", "Dimension", "Real", "Binary", "Unit"]
    own = "{" + SSP1 + kind + "}"
    common = "{" + SSP1 + "Common}"
    tags = st.sampled_from([own + name for name in names] + [common + name for name in shared])
    attributes = st.dictionaries(
        st.sampled_from(
            ["name", "value", "unit", "source", "target", "size", "factor", "version", "suppressUnitConversion"]
        ),
        st.sampled_from([value for value in VALUES if "\0" not in value])
        | st.text(st.characters(codec="ascii", min_codepoint=32)),
    )

    def grow(parent: etree._Element, depth: int) -> None:
        for _ in range(data.draw(st.integers(0, 3 if depth < 4 else 0))):
            child = etree.SubElement(parent, data.draw(tags), data.draw(attributes))
            grow(child, depth + 1)

    tag, read = ROOTS[kind]
    root = etree.Element(own + tag, data.draw(attributes))
    grow(root, 0)
    problems: list[Problem] = []
    read(Reader("x", problems), root)
    assert all(problem.message and problem.where.path == "x" for problem in problems)


@given(st.text() | st.sampled_from(VALUES))
def test_references_are_refused_or_relative(uri: str) -> None:
    trouble, target = read_reference(uri)
    if trouble is None:
        assert target.path or target.fragment
        assert not target.path.startswith("/") and "\0" not in target.path and "\\" not in target.path
    else:
        assert target.path == "" and target.fragment is None


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    names=st.lists(st.text(st.characters(codec="utf-8", exclude_characters="\0"), min_size=1, max_size=20), max_size=4)
)
def test_archives_with_any_names(tmp_path: Path, names: list[str], recwarn: Any) -> None:
    path = tmp_path / "a.ssp"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("SystemStructure.ssd", "<oops/>")
        for name in names:
            archive.writestr(name, b"x")
    before = set(tmp_path.parent.iterdir())
    with pytest.raises(SystemDescriptionError):
        read_system(path)
    assert set(tmp_path.parent.iterdir()) == before and list(tmp_path.iterdir()) == [path]
