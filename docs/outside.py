"""A hook of mkdocs: pages that stand outside this folder take part in the site, and links to them lead there.

The pages themselves keep the links that work in the repository.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parents[1]
# file of the repository → file of the site
OUTSIDE = {
    "README.md": "project/readme.md",
    "CHANGELOG.md": "project/changelog.md",
    "CONTRIBUTING.md": "project/contributing.md",
    "SECURITY.md": "project/security.md",
    "LICENSE": "project/licence.txt",
    "deploy/scenarios/README.md": "project/scenarios.md",
    "deploy/campaigns/README.md": "project/campaigns.md",
    "deploy/fleets/README.md": "project/fleets.md",
    "services/milepost/estimation/README.md": "project/symbols.md",
}
SOURCES = {page: source for source, page in OUTSIDE.items()}
LINK = re.compile(r"(\]\()([^)#:\s]+)(#[^)\s]*)?\)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages."""
    for source, page in OUTSIDE.items():
        files.append(File.generated(config, page, abs_src_path=str(ROOT / source)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:  # noqa: ARG001
    """Let links lead to where their files stand in the site."""
    return relinked(markdown, page.file.src_uri)


def relinked(markdown: str, page: str) -> str:
    """The text of a page of the site with its links as they are in the site."""
    folder = posixpath.dirname(SOURCES.get(page, f"docs/{page}"))

    def moved(link: re.Match[str]) -> str:
        target = posixpath.normpath(posixpath.join(folder, link[2]))
        place = OUTSIDE.get(target, target.removeprefix("docs/") if target.startswith("docs/") else "")
        if not place:
            return link[0]  # mkdocs reports it
        return f"{link[1]}{posixpath.relpath(place, posixpath.dirname(page) or '.')}{link[3] or ''})"

    return LINK.sub(moved, markdown)
