"""Pages from templates: text stays text, numbers that JSON lacks are refused, and what a page needs is in the package."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from jinja2 import UndefinedError

from tests.support.paths import ROOT
from urdfcal.output.templates import content_security_policy, filled_template

EVIL = "</script><b title='x'>&amp;\\"


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A package with a folder of templates."""
    (tmp_path / "with_page" / "page").mkdir(parents=True)
    (tmp_path / "with_page" / "__init__.py").touch()
    files = {
        "a.j2": '{% if word %}\n<p title="{{ word }}">{{ word }}</p>\n{% endif %}\n<script>{{ word | tojson }}</script>\n',
        "json.j2": "{{ value | tojson }}",
        "file.j2": "<style>{{ file('a.css') | safe }}</style>",
        "a.css": "a > b { content: '{{ word }} {# no comment #}'; }",
    }
    for name, text in files.items():
        (tmp_path / "with_page" / "page" / name).write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "with_page", raising=False)
    return "with_page"


def test_what_is_put_in_is_text(package: str) -> None:
    """In elements, attributes and scripts alike; lines of statements leave nothing behind."""
    text = "&lt;/script&gt;&lt;b title=&#39;x&#39;&gt;&amp;amp;\\"
    json = r'"\u003c/script\u003e\u003cb title=\u0027x\u0027\u003e\u0026amp;\\"'
    assert filled_template(package, "a.j2", word=EVIL) == f'<p title="{text}">{text}</p>\n<script>{json}</script>\n'


def test_json_keeps_its_order_and_has_no_space(package: str) -> None:
    """Entries stand as they were put in."""
    assert filled_template(package, "json.j2", value={"b": [1, 2.5], "a": None}) == '{"b":[1,2.5],"a":null}'


@pytest.mark.parametrize("value", [float("nan"), float("inf"), [1.0, -float("inf")]])
def test_numbers_that_json_lacks_are_refused(package: str, value: object) -> None:
    """A browser would refuse the whole page."""
    with pytest.raises(ValueError, match="not JSON compliant"):
        filled_template(package, "json.j2", value=value)


def test_styles_and_scripts_stand_as_they_are(package: str) -> None:
    """They are neither escaped nor templates themselves."""
    assert filled_template(package, "file.j2", word="x") == "<style>a > b { content: '{{ word }} {# no comment #}'; }</style>"


def test_what_a_template_lacks_is_an_error(package: str) -> None:
    """A name that nothing was given for is no empty text."""
    with pytest.raises(UndefinedError, match="word"):
        filled_template(package, "a.j2")


def test_every_page_has_its_policy_before_all_else() -> None:
    """Every template of a whole page states it behind its encoding, and nothing else in the package writes pages of its own."""
    pages = [path for path in (ROOT / "urdfcal").rglob("*.j2") if "<html" in path.read_text("utf-8")]
    assert len(pages) >= 2
    policy = r'\s*<meta charset="utf-8">\s*<meta http-equiv="Content-Security-Policy" content="\{\{ policy\([^"]*\) \}\}">'
    for page in pages:
        assert re.match(policy, page.read_text("utf-8").split("<head>")[1])
    tag = re.compile(r"<(!doctype|html|head|body|script)\b", re.IGNORECASE)
    others = [path for path in (ROOT / "urdfcal").rglob("*.py") if tag.search(path.read_text("utf-8"))]
    assert [path.name for path in others] == ["templates.py"]  # in its docstrings


def test_a_policy_allows_its_own_scripts_alone() -> None:
    """By the hash of what stands between the tags, as `openssl dgst -sha256 -binary | base64` has it; without scripts none."""
    assert "script-src" not in content_security_policy()
    assert content_security_policy().startswith("default-src 'none'; ")
    known = "'sha256-qznLcsROx4GACP2dm0UCKCzCG+HiZ1guq6ZZDob/Tng='"  # of alert('Hello, world.'), the example of the standard
    assert content_security_policy("alert('Hello, world.');").endswith(f"script-src {known}")
    assert content_security_policy("a", "b").count("'sha256-") == 2
    for loophole in ("unsafe-eval", "http", "*", "blob:", "connect-src", "worker-src"):
        assert loophole not in content_security_policy("a")


def test_the_files_of_pages_are_in_the_package() -> None:
    """Whatever stands in a folder `page` is declared as data of its package, and the folders hold nothing else than pages need."""
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["setuptools"]["package-data"]
    folders = [folder for folder in sorted((ROOT / "urdfcal").rglob("page")) if folder.is_dir()]
    assert folders
    for folder in folders:
        assert "page/*" in declared[".".join(folder.parent.relative_to(ROOT).parts)]
        assert {path.suffix for path in folder.iterdir()} <= {".j2", ".css", ".js"}


def test_only_pages_load_jinja2_and_only_yaml_loads_ruamel() -> None:
    """Neither the package nor its command line does at start-up."""
    code = "import urdfcal, urdfcal.cli.main, sys; print(*sorted({'jinja2', 'markupsafe', 'ruamel.yaml'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
