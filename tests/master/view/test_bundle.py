"""The bundle is made of the sources that lie beside it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path

import pytest

from cosim_master.view import bundle
from cosim_master.view.bundle import digest_of_sources, read_bundle

VIEW = Path(bundle.__file__).parent
PAGE, BUNDLE = VIEW / "page", VIEW / "bundle"


def test_nobody_has_forgotten_to_build_it() -> None:
    assert read_bundle().digest == digest_of_sources(PAGE), "run `npm ci && node build.mjs ../bundle` in view/page"


def test_the_digest_sees_every_source(tmp_path: Path) -> None:
    shutil.copytree(PAGE, tmp_path / "page", ignore=shutil.ignore_patterns("node_modules"))
    before = digest_of_sources(tmp_path / "page")
    for name in ("build.mjs", "package-lock.json", "src/main.js", "src/style.css", "src/shell.html"):
        file = tmp_path / "page" / name
        text = file.read_text(encoding="utf-8")
        file.write_text(text + " ", encoding="utf-8")
        assert digest_of_sources(tmp_path / "page") != before, name
        file.write_text(text, encoding="utf-8")
    assert digest_of_sources(tmp_path / "page") == before


def test_licences_go_with_it() -> None:
    script = read_bundle().script
    assert (
        script.count("The MIT License") + script.count("MIT License (MIT)") + script.count("Permission is hereby") >= 2
    )
    assert "three.js authors" in script and "Leon Sorokin" in script


def test_it_is_small_and_names_no_host_to_ask() -> None:
    whole = read_bundle()
    assert len(whole.script) + len(whole.style) + len(whole.body) < 1_000_000
    lock = json.loads((PAGE / "package-lock.json").read_text(encoding="utf-8"))
    assert not any("resolved" in one for one in lock["packages"].values())
    assert all("integrity" in one for name, one in lock["packages"].items() if name)


@pytest.mark.slow
def test_building_it_anew_gives_the_same_bytes(tmp_path: Path) -> None:
    """With Node and its registry at hand only; whoever has neither has the bundle."""
    node, npm = shutil.which("node"), shutil.which("npm")
    if node is None or npm is None:
        pytest.skip("node and npm are not installed")
    shutil.copytree(PAGE, tmp_path / "page", ignore=shutil.ignore_patterns("node_modules"))
    room = {"cwd": tmp_path / "page", "env": {**os.environ, "npm_config_cache": str(tmp_path / "cache")}}
    quiet = ["--no-audit", "--no-fund", "--ignore-scripts", "--fetch-retries=0", "--fetch-timeout=20000"]
    try:
        packages = subprocess.run([npm, "ci", *quiet], capture_output=True, text=True, timeout=120, **room)
    except subprocess.TimeoutExpired:
        pytest.skip("the npm registry does not answer")
    if packages.returncode != 0:
        assert "EINTEGRITY" not in packages.stderr, packages.stderr
        assert "lock file" not in packages.stderr, packages.stderr
        pytest.skip(f"the npm registry cannot be reached: {packages.stderr.strip().splitlines()[-1]}")
    subprocess.run([node, "build.mjs", tmp_path / "new"], check=True, timeout=120, **room)
    new = {file.name: file.read_bytes() for file in (tmp_path / "new").iterdir()}
    assert new == {file.name: file.read_bytes() for file in BUNDLE.iterdir()}
