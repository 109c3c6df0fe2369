"""The pages of the documentation, taken apart: blocks, links, headings."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
# made by `milepost schema`, which is tested in tests/contract
MADE = {"reference-configuration.md", "reference-messages.md", "reference-events.md", "reference-commands.md"}
OUTSIDE = ("README.md", "CONTRIBUTING.md", "SECURITY.md", "deploy/scenarios/README.md", "deploy/campaigns/README.md")
OUTSIDE = (*OUTSIDE, "deploy/fleets/README.md", "services/milepost/estimation/README.md")
FENCE = re.compile(r"^(```+)(\w*)[ ]?(.*)$")
LINK = re.compile(r"\]\(([^)\s]+)\)")


@dataclass
class Block:
    """A fenced block: its language, what stands behind that, its lines."""

    language: str
    title: str
    lines: list[str] = field(default_factory=list)

    @property
    def text(self) -> str:
        return "\n".join(self.lines) + "\n"


@dataclass(frozen=True)
class Page:
    """A page by its path."""

    path: Path

    @property
    def name(self) -> str:
        return self.path.relative_to(ROOT).as_posix()

    @cached_property
    def parts(self) -> tuple[list[Block], list[str]]:
        """The blocks, and the lines between them."""
        blocks: list[Block] = []
        prose: list[str] = []
        inside: Block | None = None
        for line in self.path.read_text(encoding="utf-8").splitlines():
            fence = FENCE.match(line)
            if inside is not None:
                if fence and not fence[2]:
                    inside = None
                else:
                    inside.lines.append(line)
            elif fence:
                inside = Block(fence[2], re.sub(r'^title="(.*)"$', r"\1", fence[3]))
                blocks.append(inside)
            else:
                prose.append(line)
        assert inside is None, f"{self.name}: a block does not end"
        return blocks, prose

    @property
    def blocks(self) -> list[Block]:
        return self.parts[0]

    @property
    def files(self) -> dict[str, str]:
        """The files that the page has the reader write."""
        return {block.title: block.text for block in self.blocks if block.title}

    @property
    def links(self) -> list[str]:
        return [target for line in self.parts[1] for target in LINK.findall(re.sub(r"`[^`]*`", "", line))]

    @property
    def anchors(self) -> set[str]:
        """The headings, as they are named in links."""
        return {slug(line.lstrip("#")) for line in self.parts[1] if re.match(r"#{1,6} ", line)}


def slug(heading: str) -> str:
    text = unicodedata.normalize("NFKC", heading).strip().lower()
    return re.sub(r"\s", "-", re.sub(r"[^\w\s-]", "", text))


PAGES = [Page(path) for path in sorted(DOCS.rglob("*.md"))]
WRITTEN = [page for page in PAGES if page.path.name not in MADE]
EVERYWHERE = [*PAGES, *(Page(ROOT / name) for name in OUTSIDE)]
