"""The fleet's own files: summary, parameters, prior, page."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import yaml

from urdfcal.base.files import write_together
from urdfcal.fleet.outcome import Outcome, by_model, parameter_rows, summary_rows
from urdfcal.fleet.page import fleet_page
from urdfcal.fleet.prior import FleetPrior, fleet_prior
from urdfcal.fleet.prior_file import prior_entries, prior_name
from urdfcal.fleet.unlike import StandsOut

_PRIOR = "# How large errors of these robots' joints are, by urdfcal fleet; for `urdfcal fit --prior-from`\n"


def written(into: Path, outcomes: Sequence[Outcome], priors: Sequence[FleetPrior], unlike: Sequence[StandsOut]) -> list[Path]:
    """Write them together, and say which."""
    tables = {"summary": summary_rows(outcomes), "parameters": parameter_rows(outcomes)}
    files: dict[str | Path, bytes] = {into / f"{name}.csv": _as_csv(rows) for name, rows in tables.items() if rows}
    files |= {into / f"{name}.parquet": content for name, rows in tables.items() if rows and (content := _as_parquet(rows))}
    for prior in priors:
        said = yaml.safe_dump(prior_entries(prior), sort_keys=False, allow_unicode=True)
        files[into / prior_name(prior, priors)] = (_PRIOR + said).encode()
    files[into / "index.html"] = fleet_page(outcomes, priors, unlike).encode()
    write_together(files)
    return [Path(file) for file in files]


def fleet_priors(outcomes: Sequence[Outcome]) -> list[FleetPrior]:
    """What errors look like of every model of which there are robots enough."""
    found = []
    for model, own in by_model(outcomes).items():
        likelihoods = {each.name: told for each in own if (told := each.likelihood) is not None}
        if (prior := fleet_prior(likelihoods, model)) is not None:
            found.append(prior)
    return found


def _as_csv(rows: Sequence[Mapping[str, Any]]) -> bytes:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue().encode()


def _as_parquet(rows: Sequence[Mapping[str, Any]]) -> bytes:
    """The same for other programs; empty where pyarrow is not installed."""
    try:
        pyarrow, parquet = import_module("pyarrow"), import_module("pyarrow.parquet")
    except ImportError:
        return b""
    buffer = io.BytesIO()
    parquet.write_table(pyarrow.Table.from_pylist([dict(row) for row in rows]), buffer)
    return buffer.getvalue()
