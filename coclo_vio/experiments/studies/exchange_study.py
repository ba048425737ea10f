# SPDX-License-Identifier: BSD-3-Clause
"""Honesty of what filter and window exchange: errors of each piece against the truth, over its claimed covariance.

``python -m coclo_vio.experiments.studies.exchange_study RECORDING... -o out/exchange.json`` with simulated recordings
of a Daisy, their truth beside them. A piece is the motion from one keyframe to the next: the filter's, and the
window's evidence without the filter's tie. Its NEES by degree of freedom is 1 where the covariance is honest. Over a
metre the pieces are joined, their errors taken as independent: what is honest piece by piece and repeats its error is
overconfident there.
"""

import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from coclo_vio.experiments.studies.study import ResultFile, Row, parser, report
from coclo_vio.fusion.feedback import (
    DecorrelatedFeedback,
    Feedback,
    PolicyParameters,
    register_feedback_policy,
    unregister_feedback_policy,
)
from coclo_vio.geometry import se3
from coclo_vio.runs.run_config import resolve
from coclo_vio.runs.running import run_modes
from coclo_vio.simulation.simulated_recording import SIMULATED_ROBOT, truth_folder
from coclo_vio.values.arrays import Array
from coclo_vio.values.keyframes import KeyframeResult, PoseEvidence, PoseMarginal, PosePair, relative_motion
from coclo_vio.values.trajectory import Trajectory, read_tum

_POLICY = "noted"
_METRE = 1.0
_LEAST_SHARE = 1e-9  # of the largest eigenvalue: below it evidence leaves a direction open


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A motion between two keyframes.

    Attributes:
        start_ns: of its begin, in nanoseconds.
        end_ns: of its end, in nanoseconds.
        T_start_end: (4, 4).
        covariance: of its right/local error, (6, 6).
    """

    start_ns: int
    end_ns: int
    T_start_end: Array
    covariance: Array


@dataclass(slots=True)
class NotedFeedback:
    """The default policy, which notes what it exchanges.

    Attributes:
        policy: decides.
        by_filter: motions by legs and IMU.
        by_window: motions by landmarks.
    """

    policy: DecorrelatedFeedback
    by_filter: list[Piece] = field(default_factory=list)
    by_window: list[Piece] = field(default_factory=list)

    def evidence_for_window(self, pair: PosePair, known: PoseMarginal | None) -> PoseEvidence | None:
        """As the default policy."""
        return self.policy.evidence_for_window(pair, known)

    def feedback_for_filter(self, pair: PosePair, known: PoseMarginal, result: KeyframeResult) -> Feedback | None:
        """As the default policy; a keyframe was made, so both pieces are noted."""
        delta = relative_motion(pair, 0.0)
        self.by_filter.append(Piece(pair.start_ns, pair.end_ns, delta.T_start_end, delta.covariance))
        if result.evidence is not None:
            piece = motion_of(result.evidence)
            if piece is not None:
                self.by_window.append(piece)
        return self.policy.feedback_for_filter(pair, known, result)


def motion_of(evidence: PoseEvidence) -> Piece | None:
    """The motion that evidence of two poses contains; None where it leaves a direction of it open."""
    T_start_end = se3.inverse(evidence.T_world_start) @ evidence.T_world_end
    from_motion = np.eye(12)  # errors of both poses from those of [earlier pose, motion]
    from_motion[6:, :6] = se3.adjoint(se3.inverse(T_start_end))
    information = from_motion.T @ evidence.information @ from_motion
    vector = from_motion.T @ evidence.vector
    earlier, cross, motion = information[:6, :6], information[6:, :6], information[6:, 6:]
    gain = cross @ np.linalg.pinv(earlier, rcond=_LEAST_SHARE, hermitian=True)
    marginal = motion - gain @ cross.T
    values, axes = np.linalg.eigh(0.5 * (marginal + marginal.T))
    if values[0] <= _LEAST_SHARE * values[-1]:
        return None
    covariance = (axes / values) @ axes.T
    off = covariance @ (vector[6:] - gain @ vector[:6])
    return Piece(evidence.start_ns, evidence.end_ns, T_start_end @ se3.exp(off), covariance)


def piece_errors(pieces: list[Piece], truth: Trajectory) -> list[tuple[Piece, Array]]:
    """Right/local errors (6,) of the pieces that the truth covers."""
    first, last = int(truth.stamps_ns[0]), int(truth.stamps_ns[-1])
    inside = [piece for piece in pieces if first <= piece.start_ns and piece.end_ns <= last]
    if not inside:
        return []
    starts, ends = (
        truth.interpolated(np.array([getattr(piece, name) for piece in inside], dtype=np.int64)).T_world_body
        for name in ("start_ns", "end_ns")
    )
    motions = se3.inverse(starts) @ ends
    return [
        (piece, np.asarray(se3.log(se3.inverse(piece.T_start_end) @ motion)))
        for piece, motion in zip(inside, motions, strict=True)
    ]


def joined_errors(noted: list[tuple[Piece, Array]], length_m: float = _METRE) -> list[tuple[Piece, Array]]:
    """Consecutive pieces joined until they are ``length_m`` long, errors taken as independent; with their errors."""
    joined: list[tuple[Piece, Array]] = []
    begin, walked_m = 0, 0.0
    for index, (piece, _) in enumerate(noted):
        if index > begin and noted[index - 1][0].end_ns != piece.start_ns:
            begin, walked_m = index, 0.0
        walked_m += float(np.linalg.norm(piece.T_start_end[:3, 3]))
        if walked_m >= length_m:
            joined.append(_join(noted[begin : index + 1]))
            begin, walked_m = index + 1, 0.0
    return joined


def _join(noted: list[tuple[Piece, Array]]) -> tuple[Piece, Array]:
    estimated, true, covariance = np.eye(4), np.eye(4), np.zeros((6, 6))
    for piece, error in noted:
        carried = se3.adjoint(se3.inverse(piece.T_start_end))
        covariance = carried @ covariance @ carried.T + piece.covariance
        estimated, true = estimated @ piece.T_start_end, true @ piece.T_start_end @ se3.exp(error)
    whole = Piece(noted[0][0].start_ns, noted[-1][0].end_ns, estimated, covariance)
    return whole, np.asarray(se3.log(se3.inverse(estimated) @ true))


def nees_of(noted: list[tuple[Piece, Array]]) -> Row:
    """Median, mean and largest NEES by degree of freedom, of rotation, translation and both; errors in mrad and mm."""
    row: Row = {"count": len(noted)}
    if not noted:
        return row
    for name, part in (("rotation", slice(0, 3)), ("translation", slice(3, 6)), ("both", slice(0, 6))):
        values = [
            float(error[part] @ np.linalg.solve(piece.covariance[part, part], error[part])) / (part.stop - part.start)
            for piece, error in noted
        ]
        row[name] = {"median": float(np.median(values)), "mean": float(np.mean(values)), "largest": max(values)}
    errors = np.array([error for _, error in noted])
    row["rms_mrad_mm"] = (1e3 * np.sqrt(np.mean(np.square(errors), axis=0))).tolist()
    return row


def exchanged(recording: Path) -> Row:
    """The figures of one recording."""
    noted: list[NotedFeedback] = []

    def make(parameters: PolicyParameters) -> NotedFeedback:
        noted.append(NotedFeedback(DecorrelatedFeedback(parameters)))
        return noted[-1]

    register_feedback_policy(_POLICY, make, "the default, noted for a study")
    try:
        config = resolve(SIMULATED_ROBOT, settings=[f"bridge.feedback={_POLICY}"])
        with tempfile.TemporaryDirectory() as folder:
            run_modes(recording, ["combined"], config, Path(folder) / "run")
    finally:
        unregister_feedback_policy(_POLICY)
    truth = read_tum(truth_folder(recording) / "groundtruth.tum")
    row: Row = {"recording": f"{recording.parent.name}/{recording.name}"}
    for name in ("by_filter", "by_window"):
        errors = piece_errors([piece for each in noted for piece in getattr(each, name)], truth)
        row[name] = {"keyframe": nees_of(errors), "metre": nees_of(joined_errors(errors))}
    return row


def summary(rows: list[Row]) -> Row:
    """Medians over the recordings of the mean NEES."""
    result: Row = {}
    for name in ("by_filter", "by_window"):
        for span in ("keyframe", "metre"):
            known = [row[name][span] for row in rows if "both" in row[name][span]]
            parts = ("rotation", "translation", "both")
            result[f"{name}_{span}"] = {part: float(np.median([one[part]["mean"] for one in known])) for part in parts}
    return result


def main() -> None:
    """Run the study from the command line."""
    options = parser(__doc__, Path("out/exchange.json"))
    options.add_argument("recordings", type=Path, nargs="+", help="simulated recordings of a Daisy")
    chosen = options.parse_args()
    results = ResultFile(chosen.output, summary, _key)
    for recording in chosen.recordings:
        row = exchanged(recording)
        results.add(row)
        report(f"{row['recording']}: {row['by_filter']['keyframe']}, {row['by_window']['keyframe']}")
    print(results.path.read_text())


def _key(row: Row) -> tuple[int, ...]:
    return tuple(row["recording"].encode())


if __name__ == "__main__":
    main()
