"""The documentation's pages, taken apart: code blocks, tables, links, headings."""

import re
from dataclasses import dataclass
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
PAGES = (
    *("index", "installation", "tutorial", "howto", "python", "api", "conventions", "theory"),
    *("paper", "reference", "glossary", "faq"),
)

_BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_EXIT = re.compile(r"#\s*exit (\d+)\s*$")
_LINK = re.compile(r"\[[^\]]+\]\(([^)\s]+)\)")


@dataclass(frozen=True)
class Block:
    """A fenced block: its language and content."""

    language: str
    content: str


def text(page: str) -> str:
    return (DOCS / f"{page}.md").read_text(encoding="utf-8")


def blocks(page: str) -> list[Block]:
    return [Block(*match.groups()) for match in _BLOCK.finditer(text(page))]


def commands(block: Block) -> list[tuple[str, int]]:
    """Each command line with the exit status that its comment states; 0 without one."""
    found = []
    for line in block.content.splitlines():
        stated = _EXIT.search(line)
        command = line.split(" #")[0].strip()
        found.append((command, int(stated[1]) if stated else 0))
    return found


def links(page: str) -> list[str]:
    return [target for target in _LINK.findall(text(page)) if "://" not in target]


def anchors(markdown: str) -> set[str]:
    """Anchors of the headings, as GitHub makes them."""
    prose = _BLOCK.sub("", markdown)
    titles = re.findall(r"^#+ (.+)$", prose, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def table(page: str, marker: str) -> list[list[str]]:
    """Cells of the table below `<!-- marker -->`, without its head."""
    after = text(page).split(f"<!-- {marker} -->\n", 1)[1].lstrip("\n")
    rows = [line for line in after.split("\n\n", 1)[0].splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows[2:]]


def section(page: str, heading: str) -> str:
    """What stands below a heading, down to the next of its rank."""
    rank = re.match(r"#+", heading)
    assert rank is not None
    after = text(page).split(f"\n{heading}\n", 1)[1]
    return re.split(rf"^#{{1,{len(rank[0])}}} ", after, maxsplit=1, flags=re.MULTILINE)[0]
