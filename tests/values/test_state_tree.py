# SPDX-License-Identifier: BSD-3-Clause
"""State is written and read exactly: values, layout of arrays, and what shares memory or is shared."""

import json
from collections import Counter, deque
from concurrent.futures import Future
from dataclasses import dataclass, field
from functools import partial
from itertools import count
from typing import Any, NamedTuple

import numpy as np
import pytest

from coclo_vio.values.array_store import ArrayReader
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.object_fields import CheckpointUnsupported
from coclo_vio.values.object_index import ObjectIndex
from coclo_vio.values.outputs import Event
from coclo_vio.values.tree_reader import TreeReader
from coclo_vio.values.tree_writer import TreeWriter


class Pair(NamedTuple):
    left: Any
    right: Any


@dataclass
class Holder:
    model: object = field(default_factory=object)
    values: dict[str, Any] = field(default_factory=dict)

    def double(self, number: int) -> int:
        return 2 * number * len(self.values)


@dataclass(frozen=True, slots=True)
class Frozen:
    number: float


def there_and_back(holder: Holder) -> dict[str, Any]:
    """The values of a holder, written after it was indexed empty, in another one."""
    values, holder.values = holder.values, {"template": Frozen(1.0), "pair": Pair(1, 2)}
    index = ObjectIndex(holder)
    holder.values = values
    writer = TreeWriter(index, {})
    root = writer.node(holder)
    text = json.dumps([root, writer.table])
    fresh = Holder(values={"template": Frozen(1.0), "pair": Pair(1, 2)})
    root, table = json.loads(text)
    found = TreeReader(table, ArrayReader(writer.arrays.blocks()), ObjectIndex(fresh), {}).value(root)
    assert found is fresh
    return fresh.values


def test_values_come_back_as_they_were() -> None:
    number = count(3)
    next(number)
    values: dict[str, Any] = {
        "plain": [1, True, None, "text", 0.1 + 0.2, float("inf"), -0.0, b"bytes", 1j],
        "numpy": [np.float64(0.1), np.int32(7), np.bool_(True)],
        "keys": {(1, "a"): 1, 7: 2, None: 3},
        "many": [deque([1, 2], maxlen=5), Counter("aab"), {3, 1}, frozenset({2}), slice(1, None, 2)],
        "named": Pair(Frozen(0.3), (1, 2)),
        "event": Event(3, "kind", "detail"),
    }
    found = there_and_back(Holder(values={**values, "count": number}))
    assert next(found.pop("count")) == 4
    assert found == values
    assert [type(value) for value in found["numpy"]] == [np.float64, np.int32, np.bool_]
    assert found["many"][0].maxlen == 5
    assert np.signbit(found["plain"][6])


def test_arrays_keep_layout_flags_and_shared_memory() -> None:
    rng = np.random.default_rng(2)
    whole = rng.normal(size=(6, 8))
    fortran, frozen = np.asfortranarray(rng.normal(size=(3, 4))), rng.normal(size=3)
    frozen.flags.writeable = False
    swapped = np.ascontiguousarray(rng.normal(size=(2, 3, 4)).transpose(1, 0, 2)).transpose(1, 0, 2).copy(order="K")
    arrays = [
        whole,
        whole[1:4, ::2],
        whole.T,
        whole[::-1, 0],
        fortran,
        frozen,
        swapped,
        np.zeros((0, 3)),
        np.array(2.5),
    ]
    found = there_and_back(Holder(values={"arrays": arrays}))["arrays"]
    for one, other in zip(arrays, found, strict=True):
        np.testing.assert_array_equal(one, other)
        assert one.dtype == other.dtype
        assert one.size == 0 or one.strides == other.strides
        assert one.flags.writeable == other.flags.writeable
    found[0][2, 2] = 77.0
    assert found[1][1, 1] == found[2][2, 2] == 77.0
    assert whole[2, 2] != 77.0


def test_what_is_shared_is_shared_again_and_may_hold_itself() -> None:
    shared = {"a": 1}
    loop: list[Any] = [shared]
    loop.append(loop)
    found = there_and_back(Holder(values={"one": shared, "loop": loop}))
    assert found["loop"][0] is found["one"]
    assert found["loop"][1] is found["loop"]


def test_methods_functions_and_results_find_their_way() -> None:
    holder = Holder()
    done: Future[int] = Future()
    done.set_result(5)
    holder.values = {"method": holder.double, "partial": partial(holder.double, 4), "done": done, "three": 3}
    found = there_and_back(holder)
    assert found["method"](1) == 8
    assert found["partial"]() == 32
    assert found["method"].__self__ is not holder
    assert found["done"].result() == 5


def test_an_object_without_fields_is_that_of_the_fresh_root_and_refused_where_it_is_new() -> None:
    assert there_and_back(Holder(values={"a": 1})) == {"a": 1}
    holder = Holder()
    index = ObjectIndex(holder)
    holder.values = {"cell": memoryview(b"1")}
    with pytest.raises(CheckpointUnsupported, match=r"memoryview cannot be kept"):
        TreeWriter(index, {}).node(holder)


def test_nothing_but_this_packages_classes_is_made() -> None:
    fresh = Holder()
    table = [["object", None, "subprocess:Popen", False, []]]
    with pytest.raises(DatasetError, match=r"names subprocess:Popen, which is no part of this package; begin anew"):
        TreeReader(table, ArrayReader([]), ObjectIndex(fresh), {}).value(["r", 0])
    table = [["object", None, "coclo_vio.values.outputs:Gone", False, []]]
    with pytest.raises(DatasetError, match=r"names coclo_vio\.values\.outputs:Gone, which this version does not have"):
        TreeReader(table, ArrayReader([]), ObjectIndex(fresh), {}).value(["r", 0])
