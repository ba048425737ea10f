# SPDX-License-Identifier: BSD-3-Clause
"""How a fault is written: one text such as ``leg1_base:20:3:5``, of what, from when on, for how long, how strong."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BeforeValidator

from coclo_vio.runs.fault_spans import Span

_START = "START"


@dataclass(frozen=True, slots=True)
class TimedFault:
    """A fault that lasts for a span of time.

    Attributes:
        text: as it was written.
        span: when.
        of: name of the leg, joint or stream; empty where the form has none.
        values: what follows the span, in the order of the form.
    """

    text: str
    span: Span
    of: str
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class FaultForm:
    """The form of a fault's text.

    Attributes:
        pattern: parts separated by colons, such as ``JOINT:START:SECONDS:DEG``; what is before START is a name.
        example: a text of this form.
        limits: smallest and largest size of each value after SECONDS; zero is none of them.
    """

    pattern: str
    example: str
    limits: tuple[tuple[float, float], ...] = ()

    @property
    def has_name(self) -> bool:
        """Whether it begins with the name of a leg, joint or stream."""
        return not self.pattern.startswith(_START)

    def parse(self, text: str) -> TimedFault:
        """The fault of a text.

        Raises:
            ValueError: parts are missing, no numbers, or out of bounds.
        """
        parts = text.split(":")
        numbers = parts[self.has_name :]
        if len(parts) != len(self.pattern.split(":")) or not parts[0].strip():
            raise ValueError(f"{text!r} is no {self.pattern}, such as {self.example}")
        span = Span.parse(":".join(numbers[:2]))
        try:
            values = tuple(float(part) for part in numbers[2:])
        except ValueError as error:
            raise ValueError(f"{text!r} is no {self.pattern}, such as {self.example}") from error
        names = self.pattern.split(":")[-len(values) :] if values else []
        for name, value, (smallest, largest) in zip(names, values, self.limits, strict=True):
            if not smallest <= abs(value) <= largest:
                raise ValueError(
                    f"{text!r}: the size of {name} must be between {smallest:g} and {largest:g}, such as {self.example}"
                )
        return TimedFault(text, span, parts[0] if self.has_name else "", values)

    def checked(self, value: Any) -> str:
        """A text of this form, as it is; for the fields of a configuration.

        Raises:
            ValueError: it is none.
        """
        if not isinstance(value, str):
            quoted = "" if self.has_name else "; quote it, YAML takes 20:5 for a number of base 60"
            raise ValueError(f'must be text {self.pattern}, such as "{self.example}"{quoted}')
        self.parse(value)
        return value

    def parsed(self, texts: Sequence[str]) -> list[TimedFault]:
        """The faults of texts that were checked."""
        return [self.parse(text) for text in texts]


def one_or_more(value: Any) -> Any:
    """A sequence as it is, anything else as a sequence of one."""
    return value if isinstance(value, Sequence) and not isinstance(value, str) else (value,)


def active(faults: Sequence[TimedFault], after_ns: int) -> list[TimedFault]:
    """Those that are on at a time after the recording's first measurement, ns."""
    return [fault for fault in faults if after_ns in fault.span]


SPAN = FaultForm("START:SECONDS", "20:5")
Spans = Annotated[tuple[Annotated[str, BeforeValidator(SPAN.checked)], ...], BeforeValidator(one_or_more)]
