"""Shared by the tests of tables: the cells of a page."""

from html.parser import HTMLParser


class Cells(HTMLParser):
    """The cells of the tables of a page, by row; and that every tag is closed in its turn."""

    def __init__(self, page: str):
        super().__init__()
        self.open, self.rows, self.images, self.words = [], [], [], []
        self.feed(page)
        assert not self.open

    def handle_starttag(self, tag, attrs):
        if tag == "img":
            self.images.append(dict(attrs))
            return
        self.open.append(tag)
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)
        if self.open and self.open[-1] in ("td", "th"):
            self.rows[-1][-1] += data
