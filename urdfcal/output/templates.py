"""Pages from jinja2's templates: what goes into them is text, styles and scripts are files beside them, nothing is fetched later."""

from __future__ import annotations

from typing import Any


def filled_template(package: str, name: str, **content: Any) -> str:
    """A page from a template in the folder `page` of a package.

    Everything is escaped as text that a template does not call safe. `file(name)` in it is the text of a file beside it, for styles and
    scripts; `tojson` may stand in a <script>, and refuses numbers that JSON does not have.

    Args:
        package: For example `urdfcal.output.report`.
        name: Of the template.
        content: What the template refers to.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    loader = PackageLoader(package, "page")
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, keep_trailing_newline=True)
    environment.trim_blocks = environment.lstrip_blocks = True  # a line that is a statement leaves nothing
    environment.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}
    environment.globals["file"] = lambda beside: loader.get_source(environment, beside)[0]
    return environment.get_template(name).render(content)
