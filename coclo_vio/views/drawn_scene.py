# SPDX-License-Identifier: BSD-3-Clause
"""The one picture that all views draw: robot, feet, trajectories, uncertainty, tracks, window, events, plots."""

import logging
from collections import deque
from collections.abc import Callable

import numpy as np

from coclo_vio.geometry import se3, so3
from coclo_vio.values.arrays import Array
from coclo_vio.values.estimates import StateEstimate
from coclo_vio.values.measurements import JointSample, Measurement
from coclo_vio.values.outputs import (
    Calibration,
    Estimate,
    Event,
    Innovation,
    KeyframeHealth,
    Output,
    Picture,
    WindowSnapshot,
)
from coclo_vio.values.trajectory import Trajectory
from coclo_vio.values.trajectory_kind import trajectory_kind
from coclo_vio.views.canvas import Canvas, Colour
from coclo_vio.views.drawn_path import DrawnPath
from coclo_vio.views.drawn_robot import DrawnRobot
from coclo_vio.views.view import Setting

_log = logging.getLogger(__name__)
_ROBOT_PERIOD_NS = 40_000_000
_SIGMAS = 3.0
_WEIGHT_M = 1.0  # length of an arrow of the robot's weight
_STANCE, _SWING, _FORCE, _LANDMARK = (0.0, 0.45, 0.7), (0.85, 0.85, 0.85), (0.84, 0.37, 0.0), (0.55, 0.55, 0.55)
_TRUTH: Colour = (0.6, 0.6, 0.6)  # the viewers are dark or light
_MRAD_PER_RAD, _PERCENT = 1e3, 100.0


class Scene:
    """A ``View`` that turns measurements and outputs into drawings.

    The robot follows the first trajectory that has feet, or the first one; several modes may follow one another.
    """

    def __init__(self, canvas: Canvas, setting: Setting) -> None:
        """Take a canvas.

        Raises:
            RobotModelError: the robot's URDF cannot be read.
        """
        self._canvas, self._setting = canvas, setting
        self._robot = None if setting.robot is None else DrawnRobot(setting.robot)
        self._joints: JointSample | None = None
        self._leader: str | None = None
        self._drawn_ns: dict[str, int] = {}
        self._picture_ns: int | None = None
        self._paths: dict[str, DrawnPath] = {}
        self._truth: deque[tuple[int, Array]] | None = None
        self._has_failed = False

    def measurement(self, measurement: Measurement) -> None:
        """Keep the joints for the next picture of the robot."""
        if isinstance(measurement, JointSample):
            self._joints = measurement

    def take(self, output: Output) -> None:
        """Draw an output; what cannot be drawn is logged once and left out."""
        try:
            self._draw(output)
        except (ValueError, TypeError, RuntimeError, OSError) as error:
            if not self._has_failed:
                _log.warning("the view could not draw %s: %s", type(output).__name__, error)
            self._has_failed = True

    def close(self) -> None:
        """Finish the file and end the server."""
        for path in self._paths.values():
            path.finish()
        self._canvas.close()

    def _draw(self, output: Output) -> None:
        canvas = self._canvas
        match output:
            case Estimate(name=name, state=state):
                self._estimate(name, state)
            case Event():
                canvas.event(output.stamp_ns, output.kind, output.detail)
            case Picture() if self._setting.encode is not None and self._is_newer(output.stamp_ns):
                canvas.image(output.stamp_ns, "tracks", self._setting.encode(np.asarray(output.image)))
            case WindowSnapshot():
                canvas.points(output.stamp_ns, "landmarks", output.landmarks_world, _LANDMARK)
                canvas.frames(output.stamp_ns, "keyframes", output.T_world_keyframes)
            case Innovation():
                values = {"squared": output.squared, "degrees_of_freedom": float(output.rows)}
                canvas.numbers(output.stamp_ns, f"innovation/{output.source}", values)
            case KeyframeHealth():
                values = {"tracks": output.tracks, "landmarks": output.landmarks, "factors": output.factors}
                values |= {"reprojection_px": output.reprojection_px, "iterations": output.iterations}
                canvas.numbers(output.stamp_ns, "window", {name: float(value) for name, value in values.items()})
            case Calibration():
                turned = dict(zip(("x_mrad", "y_mrad", "z_mrad"), _MRAD_PER_RAD * output.rotation_body, strict=True))
                scale = {"stereo_scale_percent": _PERCENT * (output.stereo_scale - 1.0)}
                canvas.numbers(output.stamp_ns, "calibration", turned | scale)

    def _is_newer(self, stamp_ns: int) -> bool:
        """Whether a picture is later than the last: of several modes only the first one's are shown."""
        if self._picture_ns is not None and stamp_ns <= self._picture_ns:
            return False
        self._picture_ns = stamp_ns
        return True

    def _estimate(self, name: str, state: StateEstimate) -> None:
        nav, stamp_ns, colour = state.nav, state.stamp_ns, _rgb(trajectory_kind(name).colour)
        self._canvas.pose(stamp_ns, name, nav.T_world_body)
        self._path(name, colour).add(stamp_ns, nav.T_world_body[:3, 3])
        velocity = dict(zip("xyz", nav.velocity_world.tolist(), strict=True))
        self._canvas.numbers(stamp_ns, f"velocity/{name}", velocity)
        if state.feet is not None and self._robot is not None:
            contact = zip(self._robot.leg_names, state.feet.contact_probability.tolist(), strict=True)
            self._canvas.numbers(stamp_ns, f"contact/{name}", dict(contact))
        if self._leader is None:
            self._leader = name
            self._begin(stamp_ns, nav.T_world_body)
        if self._is_due(name, stamp_ns):
            axes, half_axes = ellipsoid_of(state.covariance[3:6, 3:6])
            pose = se3.transform(nav.T_world_body[:3, :3] @ axes, nav.T_world_body[:3, 3])
            self._canvas.ellipsoid(stamp_ns, name, pose, half_axes, colour)
            if name == self._leader:
                self._draw_robot(state)
                self._draw_truth(stamp_ns)

    def _is_due(self, name: str, stamp_ns: int) -> bool:
        """Whether so much time has passed that what moves with a trajectory is drawn again."""
        before = self._drawn_ns.get(name)
        if before is not None and 0 <= stamp_ns - before < _ROBOT_PERIOD_NS:
            return False
        self._drawn_ns[name] = stamp_ns
        return True

    def _begin(self, stamp_ns: int, T_world_body: Array) -> None:
        if self._robot is not None:
            self._canvas.robot(stamp_ns, self._robot.shapes)
        truth = self._setting.ground_truth
        if truth is not None:
            placed = truth.moved(_onto(truth, stamp_ns, T_world_body))
            self._truth = deque(zip(placed.stamps_ns.tolist(), placed.positions, strict=True))

    def _draw_robot(self, state: StateEstimate) -> None:
        T_world_body, joints, robot = state.nav.T_world_body, self._joints, self._robot
        if robot is None or joints is None:
            self._canvas.links(state.stamp_ns, T_world_body, {})
            return
        self._canvas.links(state.stamp_ns, T_world_body, robot.place(joints))
        feet = se3.apply(T_world_body, robot.feet(joints))
        is_known = np.isfinite(feet).all(axis=1)
        contact = np.zeros(len(feet)) if state.feet is None else state.feet.contact_probability
        colours = [_mixed(_SWING, _STANCE, float(share)) for share in contact[is_known]]
        self._canvas.spheres(state.stamp_ns, "feet", feet[is_known], robot.foot_m, colours)
        forces = robot.forces(joints, T_world_body[:3, :3]) @ T_world_body[:3, :3].T * (_WEIGHT_M / robot.weight_n)
        is_drawn = is_known & np.isfinite(forces).all(axis=1)
        self._canvas.arrows(state.stamp_ns, "forces", feet[is_drawn], forces[is_drawn], _FORCE)

    def _draw_truth(self, stamp_ns: int) -> None:
        while self._truth and self._truth[0][0] <= stamp_ns:
            self._path("ground_truth", _TRUTH).add(*self._truth.popleft())

    def _path(self, name: str, colour: Colour) -> DrawnPath:
        if name not in self._paths:
            draw: Callable[[int, int, Array], None] = lambda stamp_ns, part, points: self._canvas.path(  # noqa: E731
                stamp_ns, name, part, points, colour
            )
            self._paths[name] = DrawnPath(draw)
        return self._paths[name]


def ellipsoid_of(covariance: Array) -> tuple[Array, Array]:
    """Axes (3, 3), right-handed, a column each, and half axes (3,), m, of three sigmas of a covariance (3, 3), m^2."""
    variances, axes = np.linalg.eigh(0.5 * (covariance + covariance.T))
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    return axes, _SIGMAS * np.sqrt(np.maximum(variances, 0.0))


def _onto(truth: Trajectory, stamp_ns: int, T_world_body: Array) -> Array:
    """``T_world_truth`` (4, 4), by position and heading, at the pose of the ground truth nearest to a stamp."""
    T_truth_body = truth.T_world_body[int(np.argmin(np.abs(truth.stamps_ns - stamp_ns)))]
    turn = T_world_body[:3, :3] @ T_truth_body[:3, :3].T
    R = so3.about_z(float(np.arctan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])))
    return np.asarray(se3.transform(R, T_world_body[:3, 3] - R @ T_truth_body[:3, 3]))


def _rgb(text: str) -> Colour:
    """Of ``#rrggbb``."""
    red, green, blue = (int(text[at : at + 2], 16) / 255.0 for at in (1, 3, 5))
    return red, green, blue


def _mixed(one: Colour, other: Colour, share: float) -> Colour:
    red, green, blue = ((1.0 - share) * a + share * b for a, b in zip(one, other, strict=True))
    return red, green, blue
