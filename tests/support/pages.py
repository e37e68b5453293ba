"""Reader of HTML pages: the addresses that a page would load, and its visible text."""

from html.parser import HTMLParser


class Page(HTMLParser):
    """Addresses and visible text of a page."""

    def __init__(self, path):
        super().__init__()
        self.source = path.read_text(encoding="utf-8")
        self.addresses = []
        self.text = ""
        self._silent = 0
        self.feed(self.source)

    def handle_starttag(self, tag, attrs):
        self._silent += tag in ("script", "style")
        self.addresses += [value or "" for key, value in attrs if key in ("src", "href", "srcset", "data", "action")]

    def handle_endtag(self, tag):
        self._silent -= tag in ("script", "style")

    def handle_data(self, data):
        if not self._silent:
            self.text += f" {data}"
