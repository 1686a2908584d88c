"""pytest finds all files of tests, wherever they lie."""

from __future__ import annotations

from fnmatch import fnmatch
from pathlib import Path

import pytest

TESTS = Path(__file__).parent


def left_out(patterns: list[str]) -> set[str]:
    """The folders of tests into which pytest does not go."""
    folders = {folder for file in TESTS.rglob("test_*.py") for folder in file.relative_to(TESTS).parts[:-1]}
    return {folder for folder in folders if any(fnmatch(folder, pattern) for pattern in patterns)}


def test_no_folder_of_tests_is_left_out(pytestconfig: pytest.Config) -> None:
    assert left_out(pytestconfig.getini("norecursedirs")) == set()


def test_a_folder_named_build_is_left_out_by_default() -> None:
    """pytest's own patterns: 391 tests of builds did not run as long as these applied."""
    assert left_out(["*.egg", ".*", "_darcs", "build", "CVS", "dist", "node_modules", "venv", "{arch}"]) == {"build"}
