# SPDX-License-Identifier: BSD-3-Clause
"""Random changes of inputs: of bytes, of text, of numbers and keys, of YAML and of CSV tables; a function of the seed.

Every function takes a generator of random numbers and the input, and gives the changed input.
"""

import re
from collections.abc import Callable, Sequence

from numpy.random import Generator

_INTERESTING = (
    b"\x00\x00\x00\x00",
    b"\xff\xff\xff\xff",
    b"\xff\xff\xff\x7f",
    b"\x00\x00\x00\x80",
    b"\x01\x00\x00\x00",
    b"\x00\x00\x00\x40",
    b"\xff\xff\xff\xff\xff\xff\xff\xff",
    b"\xff\xff\xff\xff\xff\xff\xff\x7f",
    b"\x00\x00\x00\x00\x00\x00\xf0\x7f",
    b"\x00\x00\x00\x00\x00\x00\xf8\x7f",
)
_NUMBERS = (
    "0", "-0.0", "-1", "1e308", "-1e308", "1e400", "1e99999999", "1e-99999999", "nan", "inf", "-.inf", ".nan",
    "9223372036854775807", "9223372036854775808", "-9223372036854775809", "4294967296", "1" * 400, "1" * 5000, "0x10",
    "1_000", "012", "1:30", "true", "null", "~", "''", "[]", "{}", "[1, 2]", "2020-01-01", "2020-01-01 10:00:00", "6.0",
    "-50.0", "1e-300", "٣", "1.2.3", "--1", "+", "",
)  # fmt: skip
_YAML_VALUES = (
    *_NUMBERS, "&a [*a]", "*missing", "!!python/object/apply:os.getcwd []", "!!opencv-matrix", "!!binary aGk=",
    "!!set {a, b}", "!!timestamp 2001-01-01", "? x", "- - - -", "\"\\ud800\"", "'\x00'", "|\n  text", "{1: 2, 2.5: 3}",
    "{2020-01-01: 1}", "[[[[[[[[[[]]]]]]]]]]", "!!float x", "!!int 3.5", "{[1, 2]: 3}", "{null: 1, true: 2}",
    "a" * 5000, "/dev/null/x", "no/such/file", "../../..", "x/" * 3000,
)  # fmt: skip
_LINES = (
    "2020-01-01: 1", "1: 2", "null: 3", "? [1, 2]\n: 3", "<<: {a: 1}", "<<: 3", "%YAML:1.0", "---", "...", "\t", "- 1",
    "true: false", "2.5: x", "cam7: 3", "cam: {}", "imu0: 3", "robot: {preset: go1}", "robot: 5", "'': 1", "\x85",
    "\x00",
)  # fmt: skip
_NUMBER = re.compile(r"[-+]?\d[\d_]*(?:\.\d*)?(?:[eE][-+]?\d+)?")
_KEY = re.compile(r"[A-Za-z_#][\w .\[\]/^-]*(?=:)")


def bytes_changed(rng: Generator, data: bytes, others: Sequence[bytes]) -> bytes:
    """A few changes of bytes: flips, overwriting, removal, repetition, splices with other inputs, truncation."""
    result = bytearray(data)
    for _ in range(int(rng.integers(1, 6))):
        if not result:
            break
        at = _place(rng, len(result))
        match int(rng.integers(9)):
            case 0:
                result[at] ^= 1 << int(rng.integers(8))
            case 1:
                result[at] = int(rng.integers(256))
            case 2 | 3:
                value = _INTERESTING[int(rng.integers(len(_INTERESTING)))]
                result[at : at + len(value)] = value
            case 4:
                del result[at : at + _length(rng, len(result))]
            case 5:
                result[at:at] = result[at : at + _length(rng, len(result))]
            case 6:
                other = others[int(rng.integers(len(others)))]
                start = int(rng.integers(max(1, len(other))))
                result[at : at + _length(rng, len(result))] = other[start : start + _length(rng, len(other) + 1)]
            case 7:
                result[at : at + 64] = rng.bytes(int(rng.integers(1, 64)))
            case _:
                del result[at:]
    return bytes(result)


def text_changed(rng: Generator, data: bytes, others: Sequence[bytes]) -> bytes:
    """A change of a text: numbers, keys and lines of YAML, cells and columns of a table, or bytes."""
    if rng.random() < 0.15:
        return bytes_changed(rng, data, others)
    text = data.decode("utf-8", errors="replace")
    changes: Sequence[Callable[[Generator, str], str]] = (
        _number_replaced, _number_replaced, _value_replaced, _key_replaced, _line_inserted, _line_moved, _cell_changed,
        _column_changed, _aliases_inserted, _text_cut,
    )  # fmt: skip
    for _ in range(int(rng.integers(1, 4))):
        text = changes[int(rng.integers(len(changes)))](rng, text)
    return text.encode("utf-8", errors="surrogatepass")


def _place(rng: Generator, length: int) -> int:
    """Anywhere, but oftener near the beginning or the end, where headers and indices are."""
    share = float(rng.random())
    near = int(rng.integers(min(length, 256)))
    if share < 0.2:
        return near
    return length - 1 - near if share < 0.35 else int(rng.integers(length))


def _length(rng: Generator, most: int) -> int:
    return int(min(most, 2 ** float(rng.uniform(0, 12))))


def _of(rng: Generator, choices: Sequence[str]) -> str:
    return choices[int(rng.integers(len(choices)))]


def _replaced(rng: Generator, pattern: re.Pattern[str], text: str, values: Sequence[str]) -> str:
    found = list(pattern.finditer(text))
    if not found:
        return text
    match = found[int(rng.integers(len(found)))]
    return text[: match.start()] + _of(rng, values) + text[match.end() :]


def _number_replaced(rng: Generator, text: str) -> str:
    return _replaced(rng, _NUMBER, text, _NUMBERS)


def _value_replaced(rng: Generator, text: str) -> str:
    """What follows a colon, or an attribute's value in XML."""
    if "</" in text:
        return _replaced(rng, re.compile(r'(?<=")[^"<>]*(?=")'), text, _YAML_VALUES)
    return _replaced(rng, re.compile(r"(?<=: )[^\n]*"), text, _YAML_VALUES)


def _key_replaced(rng: Generator, text: str) -> str:
    keys = list(dict.fromkeys(_KEY.findall(text))) or ["key"]
    return _replaced(rng, _KEY, text, (*keys, "1", "2.5", "null", "2020-01-01", "", "[1, 2]", "true", "unknown", "<<"))


def _line_inserted(rng: Generator, text: str) -> str:
    lines = text.split("\n")
    lines.insert(int(rng.integers(len(lines) + 1)), _of(rng, _LINES))
    return "\n".join(lines)


def _line_moved(rng: Generator, text: str) -> str:
    """A line or several taken out, repeated, or put elsewhere."""
    lines = text.split("\n")
    at = int(rng.integers(len(lines)))
    part = lines[at : at + int(rng.integers(1, 4))]
    if rng.random() < 0.7:
        del lines[at : at + len(part)]
    if rng.random() < 0.7:
        elsewhere = int(rng.integers(len(lines) + 1))
        lines[elsewhere:elsewhere] = part
    return "\n".join(lines)


def _cell_changed(rng: Generator, text: str) -> str:
    """A cell of a table (by commas or blanks) replaced, taken out or repeated."""
    lines = text.split("\n")
    at = int(rng.integers(len(lines)))
    separator = "," if "," in lines[at] else " "
    cells = lines[at].split(separator)
    cell = int(rng.integers(len(cells)))
    match int(rng.integers(3)):
        case 0:
            cells[cell] = _of(rng, _NUMBERS)
        case 1:
            del cells[cell]
        case _:
            cells.insert(cell, cells[cell])
    lines[at] = separator.join(cells)
    return "\n".join(lines)


def _column_changed(rng: Generator, text: str) -> str:
    """One column of a table taken out, emptied, scaled or made the same everywhere."""
    lines = text.split("\n")
    separator = "," if "," in lines[0] else " "
    column, action, value = int(rng.integers(lines[0].count(separator) + 1)), int(rng.integers(3)), _of(rng, _NUMBERS)
    for number, line in enumerate(lines):
        cells = line.split(separator)
        if column < len(cells) and (number > 0 or action == 0):
            cells[column : column + 1] = [[], [""], [value]][action]
        lines[number] = separator.join(cells)
    return "\n".join(lines)


def _aliases_inserted(rng: Generator, text: str) -> str:
    """Aliases of YAML that double with each line: 2^n elements, or entities of XML that do the same."""
    depth = int(rng.integers(3, 40))
    if "</" in text:
        entities = "".join(f'<!ENTITY e{i} "&e{i - 1};&e{i - 1};">' for i in range(1, depth))
        head = f'<!DOCTYPE robot [<!ENTITY e0 "x">{entities}]>'
        body = text.partition("?>")[2] if text.startswith("<?") else text
        return f"<?xml version='1.0'?>{head}{body.replace('<link', f'&e{depth - 1};<link', 1)}"
    lines = ["x0: &x0 [1, 2]", *(f"x{i}: &x{i} [*x{i - 1}, *x{i - 1}]" for i in range(1, depth))]
    last = f"*x{depth - 1}"
    changed = _replaced(rng, re.compile(r"(?<=: )[^\n]*"), text, (last,)) if rng.random() < 0.7 else text
    return "\n".join(lines) + "\n" + changed


def _text_cut(rng: Generator, text: str) -> str:
    return text[: int(rng.integers(len(text) + 1))]
