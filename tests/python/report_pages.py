"""A report as its reader sees it."""

from __future__ import annotations

from html.parser import HTMLParser


class Text(HTMLParser):
    """What a browser shows: headline, cells and so on, without scripts and styles."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.path: list[str] = []
        self.shown: list[tuple[str, str]] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attributes)))
        if tag not in ("meta", "link"):
            self.path.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.path.pop() == tag  # well-formed

    def handle_data(self, data: str) -> None:
        if data.strip() and self.path[-1] not in ("script", "style"):
            self.shown.append((self.path[-1], data.strip()))

    def of(self, tag: str) -> list[str]:
        return [text for where, text in self.shown if where == tag]
