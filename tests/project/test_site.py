"""The documentation as a site: every link leads somewhere, and a page that is opened fetches nothing from elsewhere."""

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from urllib.parse import urlsplit

import pytest

from support.paths import ROOT

pytest.importorskip("material")
pytest.importorskip("mkdocstrings")

COMMAND = [sys.executable, "-m", "mkdocs", "build", "--strict"]
FETCHED = {"src", "srcset", "data", "poster", "action", "background"}
"""Attributes that a browser fetches by itself; of `<link>`, `href` too."""
KEPT_LINKS = {"canonical", "next", "prev", "alternate", "license", "author", "edit"}
"""Relations of links that a browser only follows on a click."""


def build(folder, *more):
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    return subprocess.run([*COMMAND, *more], cwd=folder, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Folder of the site, built without a warning."""
    folder = tmp_path_factory.mktemp("site")
    done = build(ROOT, "--site-dir", str(folder))
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


class Resources(HTMLParser):
    """Collects what a browser fetches when it opens a page."""

    def __init__(self, text):
        super().__init__()
        self.found, self._inside = [], ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self._inside = tag
        self.found += [value for name, value in attrs if name in FETCHED and value]
        if tag == "link" and not KEPT_LINKS.issuperset((given.get("rel") or "").split()):
            self.found.append(given.get("href") or "")
        self.found += in_style(given.get("style") or "")

    def handle_data(self, data):
        if self._inside == "style":
            self.found += in_style(data)


def in_style(text):
    """Addresses in CSS."""
    return [one or other for one, other in re.findall(r"url\(\s*[\"']?([^\"')]+)|@import\s+[\"']([^\"']+)", text)]


def other_host(address):
    parts = urlsplit(address.strip())
    return bool(parts.netloc) or parts.scheme in ("http", "https", "ftp", "ws", "wss")


def test_opening_a_page_fetches_nothing_from_another_host(site):
    pages = sorted(site.rglob("*.html"))
    assert len(pages) > 25
    wrong = {
        f"{page.relative_to(site)}: {address}"
        for page in pages
        for address in Resources(page.read_text(encoding="utf-8")).found
        if other_host(address)
    }
    for sheet in site.rglob("*.css"):
        wrong |= {f"{sheet.name}: {one}" for one in in_style(sheet.read_text(encoding="utf-8")) if other_host(one)}
    assert not wrong


def test_what_a_page_fetches_is_there(site):
    for page in site.rglob("*.html"):
        for address in Resources(page.read_text(encoding="utf-8")).found:
            path = urlsplit(address).path
            if path and not address.startswith(("data:", "#")) and not path.startswith("/"):
                assert (page.parent / path).exists(), (page.name, address)


@pytest.mark.parametrize(("link", "code"), [("index.md", 0), ("none.md", 1), ("../README.md", 1), ("index.md#none", 1)])
def test_the_build_counts_broken_links(tmp_path, link, code):
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "index.md").write_text(f"# Start\n\n[there]({link})\n")
    own = (ROOT / "mkdocs.yml").read_text()
    validation = own[own.index("validation:") : own.index("nav:")]
    (tmp_path / "mkdocs.yml").write_text(f"site_name: a\nstrict: true\nplugins: []\ntheme: mkdocs\n{validation}")
    assert build(tmp_path, "--site-dir", str(tmp_path / "site")).returncode == code
