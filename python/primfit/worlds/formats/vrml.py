"""The language of Webots' worlds: nodes with fields, that may be named and used again."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

_TOKEN = re.compile(
    r'(?P<skip>[\s,]+|#[^\n]*)|(?P<mark>[{}\[\]])|"(?P<string>(?:[^"\\]|\\.)*)"|(?P<word>[^\s,{}\[\]"#]+)',
    re.DOTALL,
)

_DEEPEST = 200
"""Nodes within nodes; those of real worlds are ten deep."""


@dataclass(frozen=True)
class Node:
    """A node: its kind, its fields, and the name that DEF gave it."""

    kind: str
    fields: dict[str, Any] = field(default_factory=dict)
    name: str = ""


class _Text(str):
    """A string in quotes, which is no word."""


def nodes_of(text: str) -> list[Node]:
    """The nodes of a world.

    Raises
    ------
    ValueError
        When the text is not in this language.
    """
    return _Parser(text).nodes()


class _Parser:
    def __init__(self, text: str) -> None:
        self._tokens = list(_tokens(text))
        self._at = 0
        self._named: dict[str, Node] = {}
        self._depth = 0

    def nodes(self) -> list[Node]:
        found = []
        while self._peek() is not None:
            word = self._next()
            if word in ("EXTERNPROTO", "IMPORTABLE"):
                while not isinstance(self._next(), _Text):
                    pass
            elif word == "PROTO":
                self._next()
                self._skip("[", "]")
                self._skip("{", "}")
            else:
                self._at -= 1
                node = self._node()
                if node is not None:
                    found.append(node)
        return found

    def _peek(self) -> str | None:
        return self._tokens[self._at] if self._at < len(self._tokens) else None

    def _next(self) -> str:
        token = self._peek()
        if token is None:
            raise ValueError("it ends within a node")
        self._at += 1
        return token

    def _skip(self, opening: str, closing: str) -> None:
        depth = 0
        while True:
            token = self._next()
            if not isinstance(token, _Text):
                depth += (token == opening) - (token == closing)
            if depth == 0:
                return

    def _node(self) -> Node | None:
        word, name = self._next(), ""
        if word == "NULL":
            return None
        if word == "USE":
            used = self._next()
            if used not in self._named:
                raise ValueError(f"USE {used} is of no name that DEF gave before")
            return self._named[used]
        if word == "DEF":
            name, word = self._next(), self._next()
        if self._next() != "{":
            raise ValueError(f"{word} must be followed by {{")
        self._depth += 1
        if self._depth > _DEEPEST:
            raise ValueError(f"its nodes are more than {_DEEPEST} deep")
        fields = {}
        while (key := self._next()) != "}":
            if key != "hidden":
                fields[key] = self._value()
        self._depth -= 1
        node = Node(word, fields, name)
        if name:
            self._named[name] = node
        return node

    def _value(self) -> Any:
        token = self._next()
        if isinstance(token, _Text):
            return str(token)
        if token in ("TRUE", "FALSE"):
            return token == "TRUE"
        if token == "[":
            values = []
            while self._peek() != "]":
                values.append(self._value_in_list())
            self._next()
            return values
        number = _number(token)
        if number is None:
            self._at -= 1
            return self._node()
        numbers = [number]
        while (number := _number(self._peek())) is not None:
            numbers.append(number)
            self._next()
        return numbers

    def _value_in_list(self) -> Any:
        token = self._peek()
        number = _number(token)
        if number is None and not isinstance(token, _Text) and token not in ("TRUE", "FALSE"):
            return self._node()
        self._next()
        return token if number is None else number


def _number(token: str | None) -> float | None:
    if token is None or isinstance(token, _Text):
        return None
    try:
        return float(token)
    except ValueError:
        return None


def _tokens(text: str) -> Iterator[str]:
    at = 0
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            raise ValueError(f"a string in line {text.count(chr(10), 0, at) + 1} does not end")
        at = match.end()
        if match["string"] is not None:
            yield _Text(match["string"])
        elif match["skip"] is None:
            yield match[0]
