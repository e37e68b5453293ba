"""Reader of HTML pages: the addresses that a page would load, its visible text and its scripts."""

from html.parser import HTMLParser


class Page(HTMLParser):
    """Addresses, visible text and scripts of a page."""

    def __init__(self, path):
        super().__init__()
        self.source = path.read_text(encoding="utf-8")
        self.addresses = []
        self.text = ""
        self.scripts = []
        self._inside = ""
        self.feed(self.source)

    def handle_starttag(self, tag, attrs):
        self._inside = tag
        self.scripts += [""] * (tag == "script")
        self.addresses += [value or "" for key, value in attrs if key in ("src", "href", "srcset", "data", "action")]

    def handle_endtag(self, tag):
        self._inside = ""

    def handle_data(self, data):
        if self._inside == "script":
            self.scripts[-1] += data
        elif self._inside != "style":
            self.text += f" {data}"
