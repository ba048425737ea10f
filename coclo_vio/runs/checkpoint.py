# SPDX-License-Identifier: BSD-3-Clause
"""A checkpoint of a mode that runs: the state of its estimator and of its output files, in one file without pickle.

``checkpoints/<mode>.npz`` has a JSON text (``head``) and the bytes of all arrays (``data``). It is read only by the
same version of the package, with the same configuration.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import coclo_vio
from coclo_vio.values.array_store import ArrayReader
from coclo_vio.values.errors import DatasetError
from coclo_vio.values.object_index import ObjectIndex
from coclo_vio.values.outputs import Estimator, Settling
from coclo_vio.values.tree_reader import TreeReader
from coclo_vio.values.tree_writer import Foreign, TreeWriter
from coclo_vio.values.whole_files import replacing

FORMAT = 1
"""Of the file; raised with every change of it."""
_FOLDER = "checkpoints"


@dataclass(frozen=True, slots=True)
class Position:
    """How far a mode had read its recording.

    Attributes:
        measurements: how many it had taken.
        stamp_ns: of the last of them.
        checksum: of their stamps and kinds.
    """

    measurements: int
    stamp_ns: int
    checksum: int


class _LazyGtsam:
    """GTSAM's objects; the library is loaded where there is one."""

    def changes(self, thing: Any) -> bool:
        return _gtsam().changes(thing)

    def write(self, thing: Any) -> str | None:
        return _gtsam().write(thing)

    def read(self, kind: str, text: str) -> Any:
        return _gtsam().read(kind, text)


@cache
def _gtsam() -> Foreign:
    from coclo_vio.backend.serialised import SerialisedGtsam  # noqa: PLC0415 -- loads GTSAM

    return SerialisedGtsam()


_FOREIGN: Mapping[str, Foreign] = {"gtsam": _LazyGtsam()}


class Checkpoints:
    """Writes and reads the checkpoint of a mode.

    Made with a fresh estimator: what that is made of, and what never changes, is not written.
    """

    def __init__(self, folder: Path, mode: str, estimator: Estimator) -> None:
        """Look through a fresh estimator.

        Args:
            folder: of the run.
            mode: its name.
            estimator: that no measurement has reached yet.
        """
        self._path = folder / _FOLDER / f"{mode}.npz"
        self._estimator = estimator
        self._index = ObjectIndex(estimator)

    def save(self, position: Position, others: Mapping[str, Any]) -> None:
        """Write the state of the estimator, and of others by name; it replaces the one before.

        Raises:
            CheckpointUnsupported: the estimator holds something that cannot be kept.
            OSError: it cannot be written.
        """
        if isinstance(self._estimator, Settling):
            self._estimator.settle()
        writer = TreeWriter(self._index, _FOREIGN)
        root = writer.node({"estimator": self._estimator, **others})
        blocks = writer.arrays.blocks()
        head = {
            **self._identity(),
            "position": [position.measurements, position.stamp_ns, position.checksum],
            "classes": writer.classes,
            "sizes": [len(block) for block in blocks],
            "root": root,
            "table": writer.table,
        }
        self._path.parent.mkdir(exist_ok=True)
        with replacing(self._path) as beside, beside.open("wb") as out:
            text = np.frombuffer(json.dumps(head).encode("utf-8"), np.uint8)
            np.savez(out, head=text, data=np.frombuffer(b"".join(blocks), np.uint8))

    def load(self) -> tuple[Position, dict[str, Any]] | None:
        """Give the estimator the state of the checkpoint; its position and the others. None where there is none.

        Raises:
            DatasetError: it cannot be read, or was written by another version or for another configuration.
        """
        if not self._path.is_file():
            return None
        try:
            with np.load(self._path, allow_pickle=False) as file:
                head = json.loads(file["head"].tobytes())
                data = file["data"].tobytes()
        except (OSError, ValueError, KeyError) as error:
            raise DatasetError(f"{self._path} cannot be read ({error}); begin anew with --overwrite") from error
        for key, expected in self._identity().items():
            if head.get(key) != expected:
                raise DatasetError(
                    f"{self._path} was written by another {_MEANING[key]} ({head.get(key)}, this is {expected}): its "
                    "run cannot go on exactly; begin anew with --overwrite"
                )
        starts = np.cumsum([0, *head["sizes"]]).tolist()
        blocks = [data[start:end] for start, end in pairwise(starts)]
        reader = TreeReader(head["table"], ArrayReader(blocks), self._index, _FOREIGN)
        values = reader.value(head["root"])
        values.pop("estimator")
        return Position(*head["position"]), values

    def forget(self) -> None:
        """Remove the checkpoint: the mode is finished."""
        self._path.unlink(missing_ok=True)
        if self._path.parent.is_dir() and not any(self._path.parent.iterdir()):
            self._path.parent.rmdir()

    def _identity(self) -> dict[str, Any]:
        """What a checkpoint and its reader have to have in common."""
        made_of = sha256("\n".join(self._index.signature()).encode("utf-8")).hexdigest()[:16]
        return {"format": FORMAT, "version": coclo_vio.__version__, "code": code_digest(), "estimator": made_of}


_MEANING = {
    "format": "format of checkpoints",
    "version": "version of coclo-vio",
    "code": "state of coclo-vio's code",
    "estimator": "configuration or environment",
}


@cache
def code_digest() -> str:
    """A digest of the package's own sources: results of another state of them may differ."""
    root = Path(coclo_vio.__file__).parent
    digest = sha256()
    for path in sorted(root.rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode("utf-8"))
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def forget_all(folder: Path) -> None:
    """Remove the checkpoints of a run folder."""
    for path in (folder / _FOLDER).glob("*.npz*"):
        path.unlink(missing_ok=True)
    if (folder / _FOLDER).is_dir() and not any((folder / _FOLDER).iterdir()):
        (folder / _FOLDER).rmdir()
