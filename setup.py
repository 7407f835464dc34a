"""Writes the commit into what is built, for 'rsenf --version'; all else is in pyproject.toml."""

import runpy
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

VERSION = runpy.run_path("rsenf/version.py")  # no import: its libraries aren't here


class _BuildPy(build_py):
    def run(self) -> None:
        super().run()
        if not self.editable_mode:
            built = Path(self.build_lib) / "rsenf" / VERSION["BUILT_FROM"]
            built.write_text(VERSION["commit_of"](Path.cwd()))


setup(cmdclass={"build_py": _BuildPy})
