"""Priors that a command line states, or takes from a fleet."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urdfcal.base.errors import UsageError
from urdfcal.cli.console import warn

if TYPE_CHECKING:
    from urdfcal.fleet.prior_file import FleetsWord
    from urdfcal.model.error_model import ErrorModel
    from urdfcal.model.options import ModelOptions
    from urdfcal.model.parameters import Kind, PriorScale
    from urdfcal.robot.robot import Robot


def by_the_data(prior: str) -> bool:
    """What `--prior` asks for.

    Raises:
        UsageError: it asks for neither.
    """
    if prior not in ("stated", "auto"):
        raise UsageError(f"--prior {prior}: expected stated or auto")
    return prior == "auto"


def priors_of(joint: str | None, mount: str | None, screen: str | None, beams: str | None) -> dict[Kind, PriorScale]:
    """The priors that were stated, by group."""
    from urdfcal.model.options import parse_prior

    stated: dict[Kind, str | None] = {"joint": joint, "mount": mount, "screen": screen, "beam": beams}
    return {kind: parse_prior(text) for kind, text in stated.items() if text is not None}


def fleets_prior(path: Path, joint: str | None) -> FleetsWord:
    """What a fleet says of its next robot.

    Raises:
        InputError: the file is none.
        UsageError: another one is stated, too.
    """
    from urdfcal.fleet.prior_file import read_prior

    if joint is not None:
        raise UsageError("--prior-from and --prior-joint both state the joints' prior; use one of the two")
    return read_prior(path)


def with_shared(options: ModelOptions, shared: Mapping[str, float], robot: Robot, path: Path, quiet: bool) -> ModelOptions:
    """Options that begin at what all robots of a fleet share, but for what they say of a parameter themselves.

    A parameter that this fit does not estimate is told of in a warning.
    """
    from dataclasses import replace

    from urdfcal.model.gauge import build_error_model
    from urdfcal.model.options import ParameterPrior

    if not shared:
        return options
    names = build_error_model(robot.chain, robot.rig, replace(options, fix=(), only=(), single={})).names
    unknown = [name for name in shared if name not in names]
    warn([f"{path}: {name} is shared by that fleet, and no parameter of this fit: left out" for name in unknown], quiet)
    return replace(options, single={name: ParameterPrior(mean=shared[name]) for name in shared if name in names} | dict(options.single))


def require_priors_used(priors: Mapping[Kind, Any], errors: ErrorModel) -> None:
    """Refuse priors of parameters that are not estimated.

    Raises:
        UsageError: names the first of them.
    """
    estimated = {parameter.kind for parameter in errors.parameters}
    options = {"joint": "--prior-joint", "mount": "--prior-mount", "screen": "--prior-screen", "beam": "--prior-beams"}
    for kind in priors:
        if kind not in estimated:
            raise UsageError(f"{options[kind]} is about parameters that are not estimated; --estimate adds screen, beams or beams4")
