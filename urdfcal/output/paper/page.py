"""The paper's tables beside ours as one self-contained page, in the style of reports."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

from urdfcal.output.paper.chapters import chapter_of
from urdfcal.output.paper.pictures import figure_pictures
from urdfcal.output.report.html import filled_page
from urdfcal.output.report.plots.svg import Picture
from urdfcal.simulation.paper import Repeated

PAGE_MARK = 'id="urdfcal-paper"'  # by which an earlier page is known


def paper_page(studies: Sequence[Repeated], made_of: str = "") -> str:
    """The page, as an HTML document.

    Args:
        studies: What was repeated.
        made_of: Hash of the robots' files, by which a later run knows it.
    """
    drawn: dict[str, list[Picture]] = defaultdict(list)
    for repeated in studies:
        if repeated.study.section == 4:
            drawn["convergence"] += figure_pictures(repeated)
    return filled_page("paper.html.j2", made_of=made_of, chapters=[chapter_of(repeated) for repeated in studies], pictures=drawn)
