"""Pages from jinja2's templates: what goes into them is text, styles and scripts are files beside them, nothing is fetched later.

Should text ever become more than text all the same, the page's policy keeps it from running and from reaching the network.
"""

from __future__ import annotations

import base64
import hashlib
from typing import Any

_STYLES_AND_PICTURES = ("default-src 'none'", "style-src 'unsafe-inline'", "img-src data:", "base-uri 'none'", "form-action 'none'")


def content_security_policy(*scripts: str) -> str:
    """What a page allows a browser: its own styles, pictures that are in it, and these scripts alone, known by their hashes; no network.

    Args:
        scripts: What stands between `<script>` and `</script>`, to the letter.
    """
    hashes = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts)
    own = " ".join(f"'sha256-{each}'" for each in hashes)
    return "; ".join((*_STYLES_AND_PICTURES, *([f"script-src {own}"] if own else [])))


def filled_template(package: str, name: str, **content: Any) -> str:
    """A page from a template in the folder `page` of a package.

    Everything is escaped as text that a template does not call safe. `file(name)` in it is the text of a file beside it, for styles and
    scripts; `tojson` may stand in a <script>, and refuses numbers that JSON does not have; `policy(scripts...)` is the content of the
    meta tag that every page has before anything that could load or run.

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
    environment.globals["policy"] = content_security_policy
    return environment.get_template(name).render(content)
