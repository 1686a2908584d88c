"""What pyproject.toml cannot say: the wheel carries the shipped systems and, where they have been built, their FMUs.

`make wheel` builds the FMUs and the object code of the stepping loop first; the wheel is then one of this platform.
A wheel made without them (`pip install .`) is a pure Python one, and the FMUs are built when a system first needs them
(`cosim_master.system.shipped`).
"""

from __future__ import annotations

import shutil
from pathlib import Path

from setuptools import find_packages, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py

ROOT = Path(__file__).parent
STAGED = ROOT / "build" / "shipped"
"""Where `python -m cosim_master.system.shipped` leaves the FMUs for the wheel."""
COMPILED = ROOT / "build" / "compiled"
"""Where `python -m cosim_master.stepping.warming` leaves the machine code of the stepping loop."""


class BuildWithSystems(build_py):
    """Copies master/systems, and whatever is staged, into cosim_master/shipped."""

    def run(self) -> None:
        super().run()
        if self.editable_mode:
            return
        package = Path(self.build_lib) / "cosim_master"
        shipped = package / "shipped"
        shutil.rmtree(shipped, ignore_errors=True)
        shutil.copytree(ROOT / "master" / "systems", shipped / "master" / "systems")
        if STAGED.is_dir():
            shutil.copytree(STAGED, shipped, dirs_exist_ok=True)
        shutil.rmtree(package / "compiled", ignore_errors=True)
        if COMPILED.is_dir():
            shutil.copytree(COMPILED, package / "compiled")


class WheelOfPlatform(bdist_wheel):
    """A wheel with FMUs is one of their platform, for every Python 3."""

    def finalize_options(self) -> None:
        super().finalize_options()
        self.root_is_pure = not STAGED.is_dir()

    def get_tag(self) -> tuple[str, str, str]:
        python, abi, platform = super().get_tag()
        return (python, abi, platform) if self.root_is_pure else ("py3", "none", platform)


PACKAGES = [p for folder in (".", "models", "master") for p in find_packages(str(ROOT / folder), include=["cosim*"])]

setup(packages=PACKAGES, cmdclass={"build_py": BuildWithSystems, "bdist_wheel": WheelOfPlatform})
