# SPDX-License-Identifier: BSD-3-Clause
"""Foot frames and foot radii of a description against the links and collision shapes of its URDF."""

import re
from collections.abc import Iterator

import numpy as np

from coclo_vio.robot.description import LegDescription
from coclo_vio.robot.description_finding import DescriptionFinding
from coclo_vio.robot.leg_search import MIN_MASS_KG, foot_shape
from coclo_vio.robot.sole import sole_points
from coclo_vio.robot.urdf_tree import UrdfTree
from coclo_vio.values.arrays import Array

_FOOT_WORDS = re.compile(r"sole|foot|toe|tip|contact|end(?![a-z])")
_NOT_FOOT_WORDS = re.compile(r"sensor|skin|imu|cam|dh_frame|optical|rotor|motor|marker|upper|back")
_FARTHER_M = 0.02  # a link this much farther from the knee than the foot frame: the foot is there
_WRONG_M = 0.08  # an ankle above a flat sole stands still with it; a knee above a foot does not
_RADIUS_SHARE = 0.25  # of the sphere's radius, by which a measured radius may differ from it
_CENTRE_M = 0.01
_LARGEST_RADIUS_M = 0.1
_LARGEST_SOLE_M = 0.5


def foot_findings(tree: UrdfTree, leg: LegDescription) -> Iterator[DescriptionFinding]:
    """Findings about the foot of a leg whose foot frame is a link of the tree."""
    farther = _farther_link(tree, leg)
    if farther is not None:
        link, gap_m = farther
        yield DescriptionFinding(
            "foot_frame_above_foot",
            gap_m > _WRONG_M,
            f"leg {leg.name!r}: its foot frame {leg.foot_frame!r} is not at the end of the leg: the URDF goes on to "
            f"{link!r}, {gap_m:.3f} m farther; set foot_frame to {link!r}",
            (f"legs[{leg.name}].foot_frame: {link}",),
        )
        return
    yield from _radius_findings(tree, leg)


def _farther_link(tree: UrdfTree, leg: LegDescription) -> tuple[str, float] | None:
    """The link at the end of the leg where that is not the foot frame, and how much farther it is, m."""
    placed = tree.placements()
    chain = tree.moving_chain(leg.foot_frame)
    if not chain:
        return None
    knee = placed[chain[-1].child][:3, 3]
    own = _reach(placed[leg.foot_frame], knee)
    below = set(tree.descendants(leg.foot_frame))
    best: tuple[str, float] | None = None
    for link in (*tree.rigid_with(leg.foot_frame), *tree.descendants(leg.foot_frame)):
        gap_m = _reach(placed[link], knee) - own
        if link == leg.foot_frame or gap_m < _FARTHER_M or not _can_be_foot(tree, link, is_below=link in below):
            continue
        if best is None or gap_m > best[1]:
            best = link, gap_m
    return best


def _can_be_foot(tree: UrdfTree, link: str, *, is_below: bool) -> bool:
    name = link.lower()
    if _NOT_FOOT_WORDS.search(name):
        return False
    spheres = sum(shape.kind == "sphere" for shape in tree.links[link].shapes)
    if spheres == 1 or _FOOT_WORDS.search(name):
        return True
    return is_below and tree.links[link].mass_kg > MIN_MASS_KG


def _reach(T_root_link: Array, knee: Array) -> float:
    return float(np.linalg.norm(T_root_link[:3, 3] - knee))


def _radius_findings(tree: UrdfTree, leg: LegDescription) -> Iterator[DescriptionFinding]:
    yield from _sole_findings(tree, leg)
    if leg.contact_points_m:
        return
    kind, radius_m, centre = foot_shape(tree, leg.foot_frame)
    given = leg.foot_radius_m
    where = f"legs[{leg.name}].foot_radius_m"
    if kind == "sphere":
        if given == 0.0:
            yield DescriptionFinding(
                "foot_radius_left_out",
                False,
                f"leg {leg.name!r}: the URDF has a spherical foot of {radius_m:g} m at {leg.foot_frame!r}, but "
                "foot_radius_m is 0: a rolling foot that is taken for a point shortens the path; set foot_radius_m",
                (f"{where}: {radius_m:g}",),
            )
        elif abs(given - radius_m) > _RADIUS_SHARE * radius_m:
            yield DescriptionFinding(
                "foot_radius_differs",
                False,
                f"leg {leg.name!r}: foot_radius_m is {given:g} m, but the collision sphere of {leg.foot_frame!r} has "
                f"{radius_m:g} m; measure the foot and correct one of them",
                (f"{where}: {radius_m:g}",),
            )
        apart_m = float(np.linalg.norm(centre - np.array(leg.foot_centre_m)))
        if apart_m > _CENTRE_M:
            x, y, z = (round(float(value), 5) + 0.0 for value in centre)
            yield DescriptionFinding(
                "foot_centre_differs",
                False,
                f"leg {leg.name!r}: the collision sphere of the foot is {apart_m:.3f} m away from its centre in the "
                f"description; set foot_centre_m to [{x:g}, {y:g}, {z:g}], in the axes of {leg.foot_frame!r}",
                (f"legs[{leg.name}].foot_centre_m: [{x:g}, {y:g}, {z:g}]",),
            )
    elif kind == "flat" and given > 0.0:
        yield DescriptionFinding(
            "foot_is_flat",
            False,
            f"leg {leg.name!r}: foot_radius_m is {given:g} m, but the collision shape of {leg.foot_frame!r} is flat; "
            "set foot_radius_m to 0",
            (f"{where}: 0",),
        )
    elif given > _LARGEST_RADIUS_M:
        yield DescriptionFinding(
            "foot_radius_implausible",
            False,
            f"leg {leg.name!r}: foot_radius_m is {given:g} m, more than {_LARGEST_RADIUS_M:g} m; give the radius of "
            "the spherical foot in metres, or 0",
            (where,),
        )


def _sole_findings(tree: UrdfTree, leg: LegDescription) -> Iterator[DescriptionFinding]:
    """Corners of a sole that is flat: against those of the URDF, and below the last joint."""
    where, sole = f"legs[{leg.name}].contact_points_m", sole_points(tree, leg.foot_frame)
    given = np.array(leg.contact_points_m)
    if not leg.is_flat:
        return
    if not len(given):
        if not len(sole):
            yield DescriptionFinding(
                "sole_unknown",
                False,
                f"leg {leg.name!r}: its foot is flat, but the URDF has no boxes, spheres or frames at "
                f"{leg.foot_frame!r} that show its corners, so a foot that rocks on heel or toe is not "
                "followed; set contact_points_m to the corners of the sole",
                (where,),
            )
        return
    largest_m = float(np.linalg.norm(given, axis=1).max())
    if largest_m > _LARGEST_SOLE_M:
        yield DescriptionFinding(
            "sole_implausible",
            False,
            f"leg {leg.name!r}: a corner of its sole is {largest_m:.3g} m from {leg.foot_frame!r}, more than "
            f"{_LARGEST_SOLE_M:g} m; give contact_points_m in metres, in the axes of foot_frame",
            (where,),
        )
    elif len(sole) and (apart_m := _apart_m(given, sole)) > _CENTRE_M:
        corners = ", ".join(f"[{', '.join(f'{value:.4g}' for value in point)}]" for point in sole + 0.0)
        yield DescriptionFinding(
            "sole_differs",
            False,
            f"leg {leg.name!r}: contact_points_m lies up to {apart_m:.3f} m away from the corners in the URDF at "
            f"{leg.foot_frame!r}; measure the sole and correct one of them",
            (f"{where}: [{corners}]",),
        )


def _apart_m(given: Array, sole: Array) -> float:
    """Largest difference of the two sets of corners in their bounds, m."""
    bounds = [np.array([points.min(axis=0), points.max(axis=0)]) for points in (given, sole)]
    return float(np.abs(bounds[0] - bounds[1]).max())
