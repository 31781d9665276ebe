"""The lowest versions under test are the lowest that pyproject.toml admits."""

from __future__ import annotations

import tomllib

from packaging.requirements import Requirement
from packaging.specifiers import Specifier
from packaging.utils import canonicalize_name
from packaging.version import Version

from tests.support.paths import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def versions(requirements: list[str], operator: str) -> dict[str, Version]:
    """Versions behind an operator, by the package's name as PyPI spells it."""
    read = [Requirement(requirement) for requirement in requirements]
    stated: dict[str, list[Specifier]] = {canonicalize_name(package.name): list(package.specifier) for package in read}
    return {name: Version(one.version) for name, (one,) in stated.items() if one.operator == operator}


def pinned() -> dict[str, Version]:
    """What tests/lowest.txt holds."""
    lines = (ROOT / "tests" / "lowest.txt").read_text("utf-8").splitlines()
    return versions([line for line in lines if line and not line.startswith("#")], "==")


def test_every_dependency_has_a_lowest_version() -> None:
    """A dependency states `>=` and nothing else: what it does not admit cannot be tested, and an upper bound would stop users."""
    assert len(versions(PROJECT["dependencies"], ">=")) == len(PROJECT["dependencies"])


def test_the_lowest_versions_are_tested() -> None:
    """tests/lowest.txt has each of them, with `==`."""
    tools = [line for line in PROJECT["optional-dependencies"]["test"] if ">=" in line]
    lowest = versions(PROJECT["dependencies"] + tools, ">=")
    assert {name: version for name, version in pinned().items() if name in lowest} == lowest
