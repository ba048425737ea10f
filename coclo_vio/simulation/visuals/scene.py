# SPDX-License-Identifier: BSD-3-Clause
"""Textured faces and lights, added to a MuJoCo model for the cameras. None of them is solid.

All faces of one texture make one mesh whose corners carry texture coordinates. MuJoCo's own two-dimensional mapping
would stretch a texture over the sides of a box, and give every step of a staircase the same part of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Literal, get_args

import mujoco
import numpy as np

from coclo_vio.simulation.visuals.bareness import add_bare_surfaces
from coclo_vio.simulation.visuals.config import SceneConfig
from coclo_vio.simulation.visuals.mirrors import add_mirrors
from coclo_vio.simulation.visuals.moving import add_walker
from coclo_vio.simulation.visuals.patterns import REPEATED, bricks, tiles
from coclo_vio.simulation.visuals.relief import box_faces, relief_faces
from coclo_vio.simulation.visuals.room import Face, RoomBounds, room_faces
from coclo_vio.simulation.visuals.textures import CONTRAST_FACTOR, RECIPES, dead_leaves
from coclo_vio.values.arrays import Array, ByteImage, checked, frozen
from coclo_vio.values.errors import ConfigError

__all__ = ["RoomBounds", "Surface", "SurfaceKind", "add_visuals"]

SurfaceKind = Literal["floor", "ramp", "tread", "riser", "side"]

_VISUAL_GROUP = 1
_VISUAL: Final = "visual_"
_CLOTHES: Final = "poster"  # texture of persons
_PERSON: Final = (  # middle and half edges of trunk with legs, and of the head, m
    ((0.0, 0.0, 0.75), (0.15, 0.25, 0.75)),
    ((0.0, 0.0, 1.62), (0.10, 0.10, 0.12)),
)
_PATTERNS: Final = {"leaves": dead_leaves, "tiles": tiles, "bricks": bricks}
_NEAR_M = 0.02  # nothing nearer than this is rendered
_HEADROOM_M = 2.8
_AMBIENT = 0.4
_LAMPS: Final = (((0.35, 0.2, -1.0), 0.5), ((-0.7, -0.6, -0.25), 0.25), ((0.3, -0.5, 0.8), 0.25))  # direction, light


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A rectangle of the terrain, textured on the side its normal points to.

    Attributes:
        center: its middle, world, m, (3,).
        half_extent: half its sides along its own x and y, m, (2,).
        rotation: its axes as columns, world, (3, 3); z is the outward normal.
        kind: decides its texture.

    Raises:
        ValueError: a wrong shape, an extent that is not positive, axes that are no rotation, or an unknown kind.
    """

    center: Array
    half_extent: Array
    rotation: Array
    kind: SurfaceKind

    def __post_init__(self) -> None:
        frozen(self, "center", checked("Surface.center", self.center, (3,)))
        frozen(self, "half_extent", checked("Surface.half_extent", self.half_extent, (2,)))
        frozen(self, "rotation", checked("Surface.rotation", self.rotation, (3, 3)))
        if self.half_extent.min() <= 0.0:
            raise ValueError(f"Surface.half_extent must be positive, got {self.half_extent}")
        if not np.allclose(self.rotation.T @ self.rotation, np.eye(3), atol=1e-6) or np.linalg.det(self.rotation) < 0:
            raise ValueError(f"Surface.rotation must be a rotation, got {self.rotation.tolist()}")
        if self.kind not in get_args(SurfaceKind):
            raise ValueError(f"Surface.kind must be one of {', '.join(get_args(SurfaceKind))}, got {self.kind!r}")


def add_visuals(
    spec: mujoco.MjSpec,
    surfaces: Sequence[Surface],
    config: SceneConfig,
    seed: int,
    walked: RoomBounds | None = None,
) -> None:
    """Add the terrain's textures, a room around it and lights. Same seed, same room.

    Args:
        spec: the model, changed in place: textures, materials, meshes, geoms of group 1 and lights are added.
        surfaces: faces of the terrain above the floor; the floor of the room itself, z = 0, is added.
        config: the room.
        seed: decides textures, walls, posters and clutter.
        walked: the walked area and the ceiling; by default the box around the surfaces and 2.8 m above it.

    Raises:
        ConfigError: neither surfaces nor ``walked`` are given.
    """
    rng = np.random.default_rng([seed, 1])
    terrain = [Face(each.center, each.half_extent, each.rotation, each.kind) for each in surfaces]
    bounds = walked or _box_around(terrain)
    room = room_faces(bounds, config, rng)
    faces = terrain + room + relief_faces(bounds, terrain, room, config, np.random.default_rng([seed, 6]))
    for texture in dict.fromkeys(face.texture for face in faces):
        _add_material(spec, texture, config, seed)
        _add_mesh(spec, texture, [face for face in faces if face.texture == texture], config, rng)
    _add_walkers(spec, bounds, config, seed)
    add_mirrors(spec, terrain, bounds, config, np.random.default_rng([seed, 10]))
    if config.bare_from is not None:
        add_bare_surfaces(spec, list(dict.fromkeys(face.texture for face in faces)), config.bare_from)
    spec.compiler.discardvisual = False  # set by MuJoCo's URDF reader: it drops everything that is not solid
    _light(spec)
    _frame(spec, np.concatenate([face.corners() for face in faces]))


def _box_around(faces: Sequence[Face]) -> RoomBounds:
    if not faces:
        raise ConfigError("no surfaces and no walked area are given: the room has no position; pass one of the two")
    corners = np.concatenate([face.corners() for face in faces])
    low, high = corners.min(axis=0), corners.max(axis=0)
    return RoomBounds(low[0], high[0], low[1], high[1], max(0.0, high[2]) + _HEADROOM_M)


def _add_material(spec: mujoco.MjSpec, texture: str, config: SceneConfig, seed: int) -> None:
    """A matt material of a dead-leaves tile. MuJoCo's renderer takes three channels, never one."""
    number = list(RECIPES).index(texture)
    tile_seed = int(np.random.SeedSequence([seed, 2, number]).generate_state(1)[0])
    factor = CONTRAST_FACTOR[config.texture] * config.contrast
    tile = _tile(texture, config.pattern, config.texture_px, _texel_m(texture, config), factor, tile_seed)
    added = spec.add_texture(
        name=f"visual_{texture}",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        width=config.texture_px,
        height=config.texture_px,
        nchannel=3,
    )
    added.data = np.repeat(tile[:, :, None], 3, axis=2).tobytes()
    material = spec.add_material(name=f"visual_{texture}", specular=0.0, shininess=0.0, reflectance=0.0)
    material.textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = f"visual_{texture}"


@lru_cache(maxsize=len(RECIPES))  # they take seconds to draw, and the next scene of the seed has the same
def _tile(texture: str, pattern: str, side_px: int, texel_m: float, factor: float, tile_seed: int) -> ByteImage:
    """The tile of a kind of surface, (side_px, side_px); not to be written to."""
    draw = _PATTERNS[pattern] if texture in REPEATED else dead_leaves
    return draw(RECIPES[texture], side_px, texel_m, factor, tile_seed)


def _add_walkers(spec: mujoco.MjSpec, walked: RoomBounds, config: SceneConfig, seed: int) -> None:
    """Moving persons: a trunk and a head, textured."""
    rng = np.random.default_rng([seed, 9])
    if config.moving > 0 and spec.material(_VISUAL + _CLOTHES) is None:
        _add_material(spec, _CLOTHES, config, seed)
    for number in range(config.moving):
        body = add_walker(spec, number, walked, rng)
        faces = [
            face
            for center, half in _PERSON
            for face in box_faces(np.array(center), np.array(half), np.eye(3), _CLOTHES)
        ]
        _add_mesh(spec, _CLOTHES, faces, config, rng, body)


def _add_mesh(
    spec: mujoco.MjSpec,
    texture: str,
    faces: Sequence[Face],
    config: SceneConfig,
    rng: np.random.Generator,
    body: mujoco.MjsBody | None = None,
) -> None:
    """All faces of a texture as one mesh, each face with its own part of the tile; of the world or of a body."""
    name = _VISUAL + texture if body is None else f"{_VISUAL}{body.name}"
    tile_m = _texel_m(texture, config) * config.texture_px
    local = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    corners = np.concatenate([face.corners() for face in faces])
    normals = np.repeat([face.rotation[:, 2] for face in faces], 4, axis=0)
    coordinates = [local * face.half_extent / tile_m + rng.uniform(0.0, 1.0, 2) for face in faces]
    triangles = 4 * np.arange(len(faces))[:, None] + np.array([0, 1, 2, 0, 2, 3])
    spec.add_mesh(
        name=name,
        uservert=corners.ravel(),
        usernormal=normals.ravel(),
        usertexcoord=np.concatenate(coordinates).ravel(),
        userface=triangles.ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    (spec.worldbody if body is None else body).add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        material=f"visual_{texture}",
        contype=0,
        conaffinity=0,
        mass=0.0,
        group=_VISUAL_GROUP,
    )


def _texel_m(texture: str, config: SceneConfig) -> float:
    return config.texel_m * RECIPES[texture].coarseness


def _light(spec: mujoco.MjSpec) -> None:
    """Fixed lamps that cast no shadow; MuJoCo's own headlight is switched off."""
    spec.visual.headlight.active = 0
    for number, (direction, light) in enumerate(_LAMPS):
        spec.worldbody.add_light(
            name=f"visual_lamp_{number}",
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            dir=direction,
            diffuse=[light] * 3,
            ambient=[_AMBIENT if number == 0 else 0.0] * 3,
            specular=[0.0] * 3,
            castshadow=False,
        )


def _frame(spec: mujoco.MjSpec, corners: Array) -> None:
    """Clipping distances for the whole room; multisampling and shadows off."""
    size = float(np.linalg.norm(corners.max(axis=0) - corners.min(axis=0)))
    spec.stat.extent = size
    spec.stat.center = 0.5 * (corners.max(axis=0) + corners.min(axis=0))
    spec.visual.map.znear = _NEAR_M / size
    spec.visual.map.zfar = 2.0
    spec.visual.quality.offsamples = 0
    spec.visual.quality.shadowsize = 0
