# SPDX-License-Identifier: BSD-3-Clause
"""The variables of a keyframe: each kind is registered once, and keys, sizes and covariances follow from that."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from coclo_vio.values.arrays import Array, IntArray


@dataclass(frozen=True, slots=True)
class Variable:
    """A kind of variable.

    Attributes:
        name: of it, such as "leg scale".
        letter: of its keys; no other kind has the same.
        dimensions: of its tangent space.
        reader: the method of ``gtsam.Values`` that reads it.
    """

    name: str
    letter: str
    dimensions: int
    reader: str = "atVector"

    def key(self, number: int) -> int:
        """The key of the variable with this number."""
        return int(gtsam.symbol(self.letter, number))

    def value(self, values: gtsam.Values, number: int) -> Any:
        """What ``values`` hold of the variable with this number."""
        return getattr(values, self.reader)(self.key(number))


POSE = Variable("pose", "x", 6, "atPose3")
VELOCITY = Variable("velocity", "v", 3)
BIASES = Variable("IMU biases", "b", 6, "atConstantBias")
LANDMARK = Variable("landmark", "l", 3, "atPoint3")


class KeyframeVariables:
    """The variables that each keyframe of a window has: its pose, and those that sources register.

    A keyframe's variables are eliminated in the reverse order of their registration, the pose last. The covariance of
    its state is that of [pose, velocity, the others in the order of their registration], with a velocity even where
    that is no variable.
    """

    def __init__(self, variables: Iterable[Variable] = ()) -> None:
        self._registered = [POSE]
        for variable in variables:
            self.register(variable)

    def register(self, variable: Variable) -> None:
        """Add a variable; one that is there already is shared.

        Raises:
            ValueError: another variable has its letter.
        """
        if variable in self._registered:
            return
        for other in (*self._registered, LANDMARK):
            if other.letter == variable.letter:
                raise ValueError(
                    f"the variables {other.name!r} and {variable.name!r} have the same letter {other.letter!r}; "
                    "give the new one a letter that no other has"
                )
        self._registered.append(variable)

    def __iter__(self) -> Iterator[Variable]:
        return iter(self._registered)

    def __contains__(self, variable: Variable) -> bool:
        return variable in self._registered

    @property
    def size(self) -> int:
        """Dimensions of all variables of a keyframe."""
        return sum(variable.dimensions for variable in self._registered)

    def keys(self, number: int) -> list[int]:
        """Of a keyframe, in the order of elimination."""
        return [variable.key(number) for variable in reversed(self._registered)]

    def dimensions(self, key: int) -> int:
        """Of the variable with this key, which may be a landmark."""
        letter = chr(gtsam.Symbol(key).chr())
        return next(each.dimensions for each in (*self._registered, LANDMARK) if each.letter == letter)

    def as_registered(self, covariance: Array) -> Array:
        """The covariance of a keyframe's variables in the order of elimination as one in that of registration."""
        ends = np.cumsum([variable.dimensions for variable in reversed(self._registered)])
        blocks = [
            np.arange(end - each.dimensions, end) for end, each in zip(ends, reversed(self._registered), strict=True)
        ]
        order = np.concatenate(blocks[::-1])
        return np.asarray(covariance[np.ix_(order, order)])

    @property
    def state_size(self) -> int:
        """Dimensions of a keyframe's state: of its variables and its velocity."""
        return self.size + (0 if VELOCITY in self else VELOCITY.dimensions)

    def rows(self, variable: Variable) -> slice:
        """Where a variable is in the covariance of a keyframe's state."""
        begin = 0
        for other in (POSE, VELOCITY, *(each for each in self._registered if each not in (POSE, VELOCITY))):
            if other == variable:
                return slice(begin, begin + other.dimensions)
            begin += other.dimensions
        raise ValueError(f"{variable.name!r} is no variable of a keyframe; there are {[each.name for each in self]}")

    def state_covariance(self, solved: Array) -> Array:
        """The covariance of a keyframe's state from that of its variables, in the order of registration."""
        rows: IntArray = np.concatenate([np.r_[self.rows(variable)] for variable in self._registered])
        covariance = np.zeros((self.state_size, self.state_size))
        covariance[np.ix_(rows, rows)] = solved
        return covariance
