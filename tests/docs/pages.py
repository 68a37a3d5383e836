"""What the documentation mentions: links, anchors, modules, make targets and subcommands."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]

_FENCE = re.compile(r"^( *)(```|~~~).*?^\1\2 *$", re.DOTALL | re.MULTILINE)
_CODE = re.compile(r"`[^`\n]*`")
_LINKS = (
    re.compile(r"\]\(\s*<?([^)\s>]+)>?(?:\s+\"[^\"]*\")?\s*\)"),
    re.compile(r"^ {0,3}\[[^\]]+\]: +<?([^\s>]+)", re.MULTILINE),
    re.compile(r"<(?:img|a)\b[^>]*(?:src|href)=\"([^\"]+)\""),
)
_HEADING = re.compile(r"^ {0,3}#{1,6} +(.+?)(?: +#+)? *$", re.MULTILINE)
_MODULE = re.compile(r"\bpython3? -m ([A-Za-z_][\w.]*\w)")
_MAKE = re.compile(r"(?:^|[`(]|\$ |&& )make ((?:[a-z]+)(?: |`|$|\)|,))", re.MULTILINE)
_TRILL = re.compile(r"(?:^|[`(]|\$ |&& |\S=\S+ )trill ((?:[a-z]+)(?: [a-z]+)?)", re.MULTILINE)
_FILE = re.compile(r"(?:python3?|pytest) ((?:benchmarks|tests|verification|docs)/[\w/.]*\w)")


class Broken(NamedTuple):
    """A link that leads nowhere."""

    page: str
    target: str
    reason: str


def pages(root: Path = ROOT) -> list[Path]:
    """Every page a person reads: Markdown at the top and below ``docs``."""
    return sorted([*root.glob("*.md"), *(root / "docs").rglob("*.md")])


def anchors(text: str) -> set[str]:
    """The anchors of a page's headings, as forges make them."""
    found: set[str] = set()
    for match in _HEADING.finditer(_FENCE.sub("", text)):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", match[1]).replace("\\", "").lower()
        anchor = re.sub(r"[^\w\- ]", "", words).strip().replace(" ", "-")
        number, name = 0, anchor
        while name in found:
            number += 1
            name = f"{anchor}-{number}"
        found.add(name)
    return found


def links(text: str) -> Iterator[str]:
    """Every target of a link or an image that is not in code."""
    prose = _CODE.sub("code", _FENCE.sub("", text))
    for pattern in _LINKS:
        yield from pattern.findall(prose)


def broken_links(page: Path, root: Path = ROOT) -> list[Broken]:
    """The relative links and images of ``page`` that lead nowhere."""
    text = page.read_text(encoding="utf-8")
    name = str(page.relative_to(root))
    found = []
    for target in links(text):
        if re.match(r"[a-z]+:", target):
            continue
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        if not file.exists():
            found.append(Broken(name, target, "no such file"))
        elif not file.is_relative_to(root.resolve()):
            found.append(Broken(name, target, "outside of the project"))
        elif anchor and anchor not in anchors(file.read_text(encoding="utf-8")):
            found.append(Broken(name, target, "no such heading"))
    return found


def modules(text: str) -> set[str]:
    """Modules that ``python -m`` runs."""
    return set(_MODULE.findall(text))


def files(text: str) -> set[str]:
    """Files and folders of the project that a command names."""
    return set(_FILE.findall(text))


def make_targets(text: str) -> set[str]:
    """Targets of ``make``, in code only: prose may make things, too."""
    code = "\n".join([*_CODE.findall(text), *(match[0] for match in _FENCE.finditer(text))])
    return {target.strip(" `),") for target in _MAKE.findall(code)}


def trill_options(text: str) -> Iterator[tuple[str, set[str]]]:
    """Each line of ``trill`` in a block of commands, with its long options."""
    for block in _FENCE.finditer(text):
        for line in block[0].splitlines():
            match = re.search(r"(?:^|\s)trill (\S.*?)(?:\s+#.*)?$", line)
            if match:
                yield match[1], set(re.findall(r"(?<!\S)(--[a-z][a-z-]*)", match[1]))


def subcommands(text: str) -> set[tuple[str, ...]]:
    """What follows ``trill`` in code: one or two words."""
    code = "\n".join([*_CODE.findall(text), *(match[0] for match in _FENCE.finditer(text))])
    return {tuple(words.split()) for words in _TRILL.findall(code)}
