# SPDX-License-Identifier: BSD-3-Clause
"""The corners of a flat foot: as described, or the lowest points of its URDF."""

import re
from itertools import product

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from coclo_vio.robot.description import LegDescription, RobotDescription, urdf_path
from coclo_vio.robot.urdf_tree import CollisionShape, UrdfTree, read_urdf_tree
from coclo_vio.values.arrays import Array
from coclo_vio.values.errors import RobotModelError

_THICKNESS_M = 0.015  # points that lie higher above the lowest one are not of the sole
_LEAST_AREA_M2 = 4e-4
_SOLE_WORDS = re.compile(r"toe|heel|sole|skin|contact|corner")
_SIGNS: Array = np.array(list(product((-0.5, 0.5), repeat=3)))


def soles_of(description: RobotDescription) -> tuple[Array | None, ...]:
    """The corners of each foot, (k, 3), from the foot's centre, m, foot frame.

    None for a foot that is not flat; no corners, (0, 3), for a flat foot of unknown shape.
    """
    legs = description.legs
    tree: UrdfTree | None = None
    if any(leg.is_flat and not leg.contact_points_m for leg in legs):
        try:
            tree = read_urdf_tree(urdf_path(description))
        except RobotModelError:  # Pinocchio reads more kinds of files
            tree = None
    return tuple(_sole_of(leg, tree) if leg.is_flat else None for leg in legs)


def _sole_of(leg: LegDescription, tree: UrdfTree | None) -> Array:
    points = np.array(leg.contact_points_m).reshape(-1, 3)
    if not len(points) and tree is not None and leg.foot_frame in tree.links:
        points = sole_points(tree, leg.foot_frame)
    return np.asarray(points - np.array(leg.foot_centre_m))


def sole_points(tree: UrdfTree, foot_frame: str) -> Array:
    """The corners of the sole in the axes of a link, m, (k, 3); (0, 3) where the URDF does not show them.

    Those of boxes and spheres; without these, frames that are named after parts of a sole, as toe, heel or skin. Links
    that are fixed to the foot's count too. Down is that of the URDF with all joints at zero.
    """
    placed = tree.placements()
    T_foot_root = np.linalg.inv(placed[foot_frame])
    down = -np.asarray(T_foot_root[:3, 2], dtype=np.float64)
    T_foot_link = {link: T_foot_root @ placed[link] for link in tree.rigid_with(foot_frame)}
    points = [
        _lowest(shape, T_foot_link[link], down)
        for link in T_foot_link
        for shape in tree.links[link].shapes
        if shape.size_m is not None or shape.radius_m is not None
    ]
    if not points:
        points = [T_foot_link[link][None, :3, 3] for link in T_foot_link if _SOLE_WORDS.search(link.lower())]
    return _corners(np.concatenate(points), down) if points else np.zeros((0, 3))


def _corners(points: Array, down: Array) -> Array:
    """Those of the lowest points (k, 3) that are corners seen from below."""
    depth = points @ down
    lowest = points[depth > depth.max() - _THICKNESS_M]
    level = np.linalg.svd(down[None])[2][1:]  # two directions in the ground
    try:
        hull = ConvexHull(lowest @ level.T)
    except (QhullError, ValueError):  # on a line, or too few
        return np.zeros((0, 3))
    return np.asarray(lowest[hull.vertices]) if hull.volume > _LEAST_AREA_M2 else np.zeros((0, 3))


def _lowest(shape: CollisionShape, T_foot_link: Array, down: Array) -> Array:
    """Corners of a box or the lowest point of a sphere, foot frame, m, (k, 3)."""
    if shape.radius_m is not None:
        corners = shape.position_link[None]
    else:
        corners = shape.position_link + (_SIGNS * np.array(shape.size_m)) @ shape.rotation_link.T
    placed = corners @ T_foot_link[:3, :3].T + T_foot_link[:3, 3]
    return np.asarray(placed + (shape.radius_m or 0.0) * down)
