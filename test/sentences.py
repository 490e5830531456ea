"""Whether the code can say a sentence: one that a page quotes, with examples in the place of what varies."""

from __future__ import annotations

import ast
import builtins
import re
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

Template = tuple[str | None, ...]
"""The characters of a text of the code; None where a value is put in."""

_EXAMPLE = re.compile(r"'[^']*'|/x|[\d.]+(x\d+)?|[A-Z_]+")
"""What a page puts in the place of a value: a quoted name, a topic, a number, a size, the name of a policy."""


class Sentences:
    """All texts of some Python files, docstrings left out."""

    def __init__(self, files: Iterable[Path]) -> None:
        self._templates = {t for file in files for t in _templates(ast.parse(file.read_text("utf-8")))}
        self._constants = {"".join(c for c in t if c) for t in self._templates if None not in t}
        self._openings = [t for t in self._templates if None in t and t[0] is not None]
        self._is_value = cache(self._is_value_uncached)

    def can_say(self, quoted: str) -> bool:
        """Return whether a text of the code holds these words; "..." stands for any beginning or end."""
        words = quoted.strip(". ") if quoted.startswith("...") or quoted.endswith("...") else quoted
        return any(self._holds(template, words) for template in self._templates)

    def _holds(self, template: Template, words: str) -> bool:
        return any(self._runs(template, start, words, "") for start in range(len(template)))

    def _runs(self, template: Template, at: int, words: str, literal: str) -> bool:
        """Return whether `words` go on as the template does from `at`; `literal` was word for word so far."""
        if not words:
            return len(re.findall(r"[^\W\d]{2,}", literal)) >= 2 or len(literal.strip()) >= 4
        if at == len(template):
            return False
        if template[at] is not None:
            return template[at] == words[0] and self._runs(template, at + 1, words[1:], literal + words[0])
        return any(
            self._is_value(words[:n]) and self._runs(template, at + 1, words[n:], f"{literal} ")
            for n in range(len(words), 0, -1)
        )

    def _is_value_uncached(self, words: str) -> bool:
        """Return whether this may be put in: an example, a text of the code, or the start of one with values in it."""
        if words in self._constants or _EXAMPLE.fullmatch(words):
            return True
        if isinstance(getattr(builtins, words, None), type):
            return True
        return any(self._runs(t, 0, words, "") for t in self._openings)


def _templates(tree: ast.AST) -> Iterator[Template]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            continue  # a docstring
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield tuple(node.value)
        elif isinstance(node, ast.JoinedStr):
            yield tuple(c for part in node.values for c in _characters(part))
            for part in node.values:
                if isinstance(part, ast.FormattedValue):
                    yield from _templates(part)
        else:
            yield from _templates(node)


def _characters(part: ast.expr) -> Iterable[str | None]:
    return str(part.value) if isinstance(part, ast.Constant) else (None,)
