# SPDX-License-Identifier: BSD-3-Clause
"""The result of an adoption: a robot's description whose fields have a confidence, and its YAML with what to check."""

import os
from dataclasses import dataclass
from pathlib import Path

from coclo_vio.robot.description import EXTRA_SCHEME, LegDescription, RobotDescription
from coclo_vio.values.errors import ConfigError

SURE = 0.7
"""Confidence from which a field is not asked back."""


@dataclass(frozen=True, slots=True)
class AdoptedField:
    """A field of the description, where it is from, and how sure it is.

    Attributes:
        key: of the YAML, such as ``contact.on_force``.
        value: as text.
        confidence: 0..1.
        reason: what it was found by, and what to check where it is not sure.
    """

    key: str
    value: str
    confidence: float
    reason: str

    @property
    def is_sure(self) -> bool:
        """Whether it is not asked back."""
        return self.confidence >= SURE


@dataclass(frozen=True, slots=True, eq=False)
class Adoption:
    """A robot that was found in a URDF and a log.

    Attributes:
        description: of the robot; its URDF is absolute.
        fields: each field with its confidence.
        settings: what this recording has to be read with beside the description, as ``--set`` takes it.
        notes: sentences on what the description cannot hold, such as units that have to be converted.
        ignored: by the link at its end, why a chain of the URDF is no leg.
        recording: path of the log.
    """

    description: RobotDescription
    fields: tuple[AdoptedField, ...]
    settings: tuple[str, ...]
    notes: tuple[str, ...]
    ignored: dict[str, str]
    recording: Path

    @property
    def questions(self) -> tuple[AdoptedField, ...]:
        """The fields that are not sure."""
        return tuple(field for field in self.fields if not field.is_sure)

    def confidence(self, key: str) -> float:
        """The confidence of a field; 0 where it was not found."""
        return next((field.confidence for field in self.fields if field.key == key), 0.0)

    def to_yaml(self, folder: Path) -> str:
        """The description as YAML for a file in ``folder``, with the confidences and questions as comments."""
        robot = self.description
        lines = [
            f"# {robot.name}: found by coclo-vio adopt in {Path(robot.urdf).name} and {self.recording.name}.",
            '# Numbers in comments are confidences, 0 to 1. A line with "?" is not sure: check it.',
            f"name: {_quoted(robot.name)}",
            f"urdf: {_urdf_for(robot.urdf, folder)}",
        ]
        if robot.body_frame is not None:
            lines += [*self._comments("body_frame"), f"body_frame: {_quoted(robot.body_frame)}"]
        lines += [*self._comments("legs", "joints", "foot_radius_m", "contact_points_m", "joint_signs"), "legs:"]
        for leg in robot.legs:
            lines += _leg_lines(leg)
        contact = robot.contact.model_dump(exclude_unset=True)
        lines += [*self._comments("contact"), f"contact: {_flow(contact)}"]
        imu = robot.imu.model_dump(exclude_unset=True)
        if imu:
            lines += [*self._comments("imu"), f"imu: {_flow(imu)}"]
        else:
            lines += self._comments("imu")
        if "joint_velocity_noise_radps" in robot.model_fields_set:
            lines += self._comments("joint_velocity_noise_radps")
            lines.append(f"joint_velocity_noise_radps: {robot.joint_velocity_noise_radps:g}")
        if robot.joint_aliases:
            lines += [*self._comments("joint_aliases"), "joint_aliases:"]
            lines += [f"  {_quoted(alias)}: {_quoted(joint)}" for alias, joint in robot.joint_aliases.items()]
        lines += [f"# ? {note}" for note in self.notes]
        if self.settings:
            lines.append("# This recording has to be read with: " + " ".join(f"--set '{one}'" for one in self.settings))
        lines.append("# Cameras: their mounting is no part of a robot's description; coclo-vio doctor estimates it.")
        return "\n".join(lines) + "\n"

    def write(self, path: Path) -> Path:
        """Write the YAML.

        Raises:
            ConfigError: the file cannot be written, or does not end in .yaml.
        """
        if path.suffix not in {".yaml", ".yml"}:
            raise ConfigError(f"{path} does not end in .yaml, by which --robot knows a description; choose such a name")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(self.to_yaml(path.parent), encoding="utf-8")
        except OSError as error:
            raise ConfigError(f"cannot write {path}: {error.strerror}; choose another file") from error
        return path

    def _comments(self, *keys: str) -> list[str]:
        """Comment lines on fields of these keys, and below them."""
        found = [field for key in keys for field in self.fields if field.key == key or field.key.startswith(f"{key}.")]
        return [
            f"# {'' if field.is_sure else '? '}{field.key} = {field.value} ({field.confidence:.2f}): {field.reason}"
            for field in found
        ]


def _urdf_for(urdf: str, folder: Path) -> str:
    if urdf.startswith(EXTRA_SCHEME):
        return urdf
    return _quoted(os.path.relpath(urdf, folder.resolve()))


def _leg_lines(leg: LegDescription) -> list[str]:
    lines = [
        f"  - name: {_quoted(leg.name)}",
        f"    joints: [{', '.join(_quoted(joint) for joint in leg.joints)}]",
        f"    foot_frame: {_quoted(leg.foot_frame)}",
        f"    foot_radius_m: {leg.foot_radius_m:g}",
    ]
    if any(leg.foot_centre_m):
        lines.append(f"    foot_centre_m: [{', '.join(f'{value:g}' for value in leg.foot_centre_m)}]")
    if leg.contact_points_m:
        corners = ", ".join(f"[{', '.join(f'{value:g}' for value in point)}]" for point in leg.contact_points_m)
        lines.append(f"    contact_points_m: [{corners}]")
    return lines


def _flow(values: dict[str, object]) -> str:
    return "{" + ", ".join(f"{key}: {_scalar(value)}" for key, value in values.items()) + "}"


def _scalar(value: object) -> str:
    if isinstance(value, tuple | list):
        return f"[{', '.join(_scalar(each) for each in value)}]"
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def _quoted(text: str) -> str:
    is_plain = text.replace("_", "").replace("/", "").replace("-", "").replace(".", "").isalnum() and text[:1].isalpha()
    is_word = text.lower() in {"yes", "no", "on", "off", "true", "false", "null", "y", "n"}
    return text if is_plain and not is_word else "'" + text.replace("'", "''") + "'"
