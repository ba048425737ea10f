# SPDX-License-Identifier: BSD-3-Clause
"""YAML as people have it, read within bounds: what is not plain data is refused in one sentence.

Keys are text as written (``1``, ``on`` and ``2020-01-01`` too), dates are text, OpenCV's ``%YAML:1.0`` and
``!!opencv-matrix`` are accepted, and aliases may not expand to more than ``MOST_ELEMENTS`` elements.
"""

import re
from typing import Any

import yaml

from coclo_vio.values.errors import ConfigError

MOST_CHARACTERS = 200_000
MOST_ELEMENTS = 20_000
DEEPEST = 40
_DEEPEST_BRACKETS = 200
_BRACKET = re.compile(r"[\[\]{}]")
_DIRECTIVE = re.compile(r"^%[^\n]*$", re.MULTILINE)
_OPENCV_TAG = re.compile(r"!!opencv-[\w-]+")
_TIMESTAMP = "tag:yaml.org,2002:timestamp"
_MERGE = "tag:yaml.org,2002:merge"
_TEXT = "tag:yaml.org,2002:str"


class _Loader(yaml.SafeLoader):
    """Without dates, and with no more nodes than are read."""

    _nodes = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        self._nodes += 1
        if self._nodes > MOST_ELEMENTS:
            raise ConfigError(f"has more than {MOST_ELEMENTS} elements")
        return super().compose_node(parent, index)


_Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag != _TIMESTAMP]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}


def parse_yaml(text: str) -> Any:
    """The value of a YAML document: mappings with text as keys, lists, text, numbers, booleans, None.

    Raises:
        ConfigError: not YAML, or beyond the bounds; the message is the end of a sentence without a subject.
    """
    if len(text) > MOST_CHARACTERS:
        raise ConfigError(f"has {len(text)} characters, more than the {MOST_CHARACTERS} that are read")
    if _nesting(text) > _DEEPEST_BRACKETS:  # PyYAML takes minutes for some thousands
        raise ConfigError(f"is nested more than {DEEPEST} levels deep")
    loader = None
    try:
        loader = _Loader(_OPENCV_TAG.sub("", _DIRECTIVE.sub("", text)))
        node = loader.get_single_node()
        if node is None:
            return None
        _check(node, {}, frozenset())
        return loader.construct_document(node)
    except yaml.MarkedYAMLError as error:
        raise ConfigError(f"is not YAML{_place(error)}: {_one_line(error.problem or error.context or '')}") from error
    except yaml.YAMLError as error:
        raise ConfigError(f"is not YAML: {_one_line(str(error))}") from error
    except RecursionError as error:
        raise ConfigError(f"is nested more than {DEEPEST} levels deep") from error
    except (ValueError, TypeError, OverflowError, AttributeError, KeyError, IndexError) as error:  # PyYAML's scalars
        raise ConfigError(f"holds a value that cannot be read ({_one_line(str(error))})") from error
    finally:
        if loader is not None:
            loader.dispose()


def _nesting(text: str) -> int:
    """How deep brackets are nested, those in comments and quotes counted too."""
    depth = deepest = 0
    for bracket in _BRACKET.findall(text):
        depth = depth + 1 if bracket in "[{" else max(0, depth - 1)
        deepest = max(deepest, depth)
    return deepest


def _check(node: yaml.Node, counted: dict[int, int], above: frozenset[int]) -> int:
    """The number of elements that a node expands to; makes the keys of its mappings text.

    Raises:
        ConfigError: too many, too deep, a node inside itself, or a key that is no scalar.
    """
    if id(node) in counted:
        return counted[id(node)]
    if id(node) in above or len(above) >= DEEPEST:
        what = "holds an alias of what it is in" if id(node) in above else f"is nested more than {DEEPEST} levels deep"
        raise ConfigError(f"{what} (line {node.start_mark.line + 1})")
    count, inside = 1, above | {id(node)}
    if isinstance(node, yaml.ScalarNode):
        _check_text(node)
    if isinstance(node, yaml.MappingNode):
        for key, value in node.value:
            _make_text(key)
            count += 1 + _check(value, counted, inside)
    elif isinstance(node, yaml.SequenceNode):
        count += sum(_check(value, counted, inside) for value in node.value)
    if count > MOST_ELEMENTS:
        raise ConfigError(f"expands to more than {MOST_ELEMENTS} elements (line {node.start_mark.line + 1})")
    counted[id(node)] = count
    return count


def _make_text(key: yaml.Node) -> None:
    if not isinstance(key, yaml.ScalarNode):
        raise ConfigError(f"has a key that is a list or a mapping (line {key.start_mark.line + 1}); keys must be text")
    _check_text(key)
    if key.tag != _MERGE:
        key.tag = _TEXT


def _check_text(scalar: yaml.ScalarNode) -> None:
    """See that a text has no half of a surrogate pair, which no other text can hold."""
    try:
        scalar.value.encode()
    except UnicodeEncodeError as error:
        raise ConfigError(f"holds a character that is none (line {scalar.start_mark.line + 1})") from error


def _place(error: yaml.MarkedYAMLError) -> str:
    mark = error.problem_mark or error.context_mark
    return "" if mark is None else f", line {mark.line + 1}, column {mark.column + 1}"


def _one_line(text: str) -> str:
    return " ".join(text.split())[:200]
