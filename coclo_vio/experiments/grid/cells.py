# SPDX-License-Identifier: BSD-3-Clause
"""The cells of the grid: each condition by itself around two base qualities, and the worst corners.

``good`` is a robot as described with good IMUs in a room of rich texture. ``field`` is an imperfect robot with cameras
mounted 0.2 deg and 2 mm off, and with light, texture and traffic as in the field.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from coclo_vio.simulation.conditions import CONDITIONS, condition_changes
from coclo_vio.values.config import merged
from coclo_vio.values.errors import ConfigError, listing

_GOOD: Final = ("legs_exact", "vision_exact")
_FIELD: Final = ("weak_texture", "relief", "motion_blur", "shadows", "exposure_jumps", "moving_persons")


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell: conditions that hold together.

    Attributes:
        group: of cells that belong together: a base quality, or the corners.
        name: unique, also of its folder.
        conditions: names, in order.
    """

    group: str
    name: str
    conditions: tuple[str, ...]

    @property
    def changes(self) -> Mapping[str, Any]:
        """To the configuration of a simulated recording."""
        changes: Mapping[str, Any] = {}
        for change in condition_changes(self.conditions):
            changes = merged(changes, change)
        return changes


def _around(group: str, base: tuple[str, ...], left_out: Mapping[str, str]) -> Iterator[Cell]:
    """A base, what is left out of it one by one, and each further condition by itself."""
    yield Cell(group, f"{group}-base", base)
    for name, condition in left_out.items():
        yield Cell(group, f"{group}-{name}", tuple(each for each in base if each != condition))
    for condition in CONDITIONS:
        if condition not in base:
            yield Cell(group, f"{group}-{condition}", (*base, condition))
    yield Cell(group, f"{group}-both_imus_cheap", (*base, "cheap_body_imu", "cheap_camera_imu"))


_CORNERS: Final[Mapping[str, tuple[str, ...]]] = {
    "slippery_weak": ("legs_slippery", "weak_texture"),
    "slippery_textureless_end": ("legs_slippery", "textureless_end", "cheap_body_imu"),
    "slippery_lamp_blur": ("legs_slippery", "lamp", "motion_blur", "cheap_body_imu"),
    "slippery_late": ("legs_slippery", "images_late", "poor_texture"),
    "slippery_mounting": ("legs_slippery", "mounting_3_deg", "poor_texture"),
    "encoder_weak": ("encoder_off", "weak_texture", "cheap_body_imu"),
    "encoder_mounting": ("encoder_off", "mounting_3_deg"),
    "encoder_textureless_end": ("encoder_off", "textureless_end"),
    "mounting_cheap": ("mounting_3_deg", "cheap_body_imu", "cheap_camera_imu"),
    "far_cheap": ("far_walls", "poor_texture", "cheap_body_imu", "cheap_camera_imu"),
    "persons_mirrors": ("moving_persons", "mirrors", "tiles", "legs_slippery"),
    "exact_legs_weak": ("legs_exact", "weak_texture", "cheap_camera_imu"),
    "exact_vision_slippery": ("vision_exact", "legs_slippery", "encoder_off", "cheap_body_imu"),
    "everything": (
        *("legs_slippery", "encoder_off", "mounting_3_deg", "images_late", "weak_texture", "relief", "motion_blur"),
        *("shadows", "exposure_jumps", "moving_persons", "mirrors", "cheap_body_imu", "cheap_camera_imu"),
    ),
}

CELLS: Final[tuple[Cell, ...]] = (
    *_around("good", _GOOD, {"imperfect_legs": "legs_exact", "mounting_0.2_deg": "vision_exact"}),
    *_around("field", _FIELD, {f"no_{condition}": condition for condition in _FIELD}),
    *(Cell("corners", name, conditions) for name, conditions in _CORNERS.items()),
)
"""All cells of the grid."""


def chosen_cells(names: Sequence[str]) -> tuple[Cell, ...]:
    """The cells of these names, or of groups of these names; all cells without a name.

    Raises:
        ConfigError: a name that no cell and no group has.
    """
    for name in names:
        if not any(name in (cell.name, cell.group) for cell in CELLS):
            known = dict.fromkeys((*(cell.group for cell in CELLS), *(cell.name for cell in CELLS)))
            raise ConfigError(f"there is no cell {name!r}; choose from {listing(known)}")
    return tuple(cell for cell in CELLS if not names or cell.name in names or cell.group in names)
