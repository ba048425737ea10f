# SPDX-License-Identifier: BSD-3-Clause
"""State estimation for legged robots from leg odometry and stereo vision: any URDF, no ROS.

``import coclo_vio as cv`` loads nothing else; each name below loads what it needs when it is first used (PEP 562).
"""

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.1.0"

_HOMES = {
    "adoption.adoption": ("AdoptedField", "Adoption"),
    "api.robot_adoption": ("adopt",),
    "api.play": ("OutputSink", "Play", "play"),
    "api.recording": ("Recording",),
    "api.run": ("Run", "load_ground_truth", "load_run", "run"),
    "api.comparison": ("ComparedRecording", "Comparison", "compare"),
    "api.trajectory_evaluation": ("evaluate",),
    "api.online": ("make_estimator",),
    "api.viewing": ("open_view", "view_run"),
    "datasets.dataset": ("Dataset", "register_format"),
    "datasets.sample": ("sample_path",),
    "evaluation.evaluate": ("EvaluationConfig",),
    "evaluation.evaluation": ("Evaluation",),
    "evaluation.ranking": ("Ranking",),
    "fusion.feedback": ("Feedback", "FeedbackPolicy", "PolicyParameters", "register_feedback_policy"),
    "fusion.streaming": ("StreamingEstimator",),
    "online.guarded_estimator": ("GuardedEstimator",),
    "robot.contact": ("ContactConfig", "ContactEstimator", "ContactState", "register_contact_estimator"),
    "robot.description": ("RobotDescription", "load_robot", "robot_names"),
    "runs.equipment": ("Equipment",),
    "runs.inspection": ("Inspection",),
    "runs.latency": ("LatencyRecord",),
    "runs.modes.mode": ("Compared", "Mode", "Need"),
    "runs.modes.registry": ("modes", "register_mode", "unregister_mode"),
    "runs.run_config": ("RunConfig",),
    "runs.run_folder": ("Existing", "RecordedTrajectory"),
    "runs.run_record": ("RunRecord",),
    "runs.running": ("Ending",),
    "runs.stop_request": ("RunStopped", "StopRequest"),
    "values.calibration": ("CameraCalibration", "ImuCalibration", "SensorCalibrations", "StereoCalibration"),
    "values.errors": (
        "CalibrationMissing",
        "CocloError",
        "ConfigError",
        "DatasetError",
        "EvaluationError",
        "FilterError",
        "RobotModelError",
        "SmootherError",
        "TimestampError",
        "TopicNotFound",
    ),
    "values.keyframes": ("KeyframeResult", "OdometryDelta", "PoseEvidence", "PoseMarginal", "PosePair"),
    "values.estimates": ("FootState", "NavState", "StateEstimate"),
    "values.measurements": (
        "BodyTwistSample",
        "CameraImuSample",
        "FootForceSample",
        "ImuSample",
        "JointSample",
        "Measurement",
        "StereoFrame",
        "StereoTracks",
    ),
    "values.outputs": (
        "Calibration",
        "Estimate",
        "Estimator",
        "Event",
        "Innovation",
        "KeyframeHealth",
        "Output",
        "Picture",
        "Status",
        "StreamStatus",
        "WindowSnapshot",
    ),
    "values.trajectory": ("GroundTruth", "Trajectory", "read_tum", "write_tum"),
    "values.trajectory_kind": ("TrajectoryKind",),
    "views.view": ("View",),
}
_MODULES = {name: module for module, names in _HOMES.items() for name in names}
_RENAMED = {"open": ("api.recording", "open_recording")}  # the built-in's name, as numpy and PIL do

__all__ = [  # noqa: PLE0604 -- made from the table above
    "__version__",
    "open",
    *sorted(_MODULES),
]


def __getattr__(name: str) -> object:
    module, attribute = _RENAMED.get(name) or (_MODULES.get(name), name)
    if module is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f"{__name__}.{module}"), attribute)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)


if TYPE_CHECKING:
    from coclo_vio.adoption.adoption import AdoptedField as AdoptedField
    from coclo_vio.adoption.adoption import Adoption as Adoption
    from coclo_vio.api.comparison import ComparedRecording as ComparedRecording
    from coclo_vio.api.comparison import Comparison as Comparison
    from coclo_vio.api.comparison import compare as compare
    from coclo_vio.api.online import make_estimator as make_estimator
    from coclo_vio.api.play import OutputSink as OutputSink
    from coclo_vio.api.play import Play as Play
    from coclo_vio.api.play import play as play
    from coclo_vio.api.recording import Recording as Recording
    from coclo_vio.api.recording import open_recording as open
    from coclo_vio.api.robot_adoption import adopt as adopt
    from coclo_vio.api.run import Run as Run
    from coclo_vio.api.run import load_ground_truth as load_ground_truth
    from coclo_vio.api.run import load_run as load_run
    from coclo_vio.api.run import run as run
    from coclo_vio.api.trajectory_evaluation import evaluate as evaluate
    from coclo_vio.api.viewing import open_view as open_view
    from coclo_vio.api.viewing import view_run as view_run
    from coclo_vio.datasets.dataset import Dataset as Dataset
    from coclo_vio.datasets.dataset import register_format as register_format
    from coclo_vio.datasets.sample import sample_path as sample_path
    from coclo_vio.evaluation.evaluate import EvaluationConfig as EvaluationConfig
    from coclo_vio.evaluation.evaluation import Evaluation as Evaluation
    from coclo_vio.evaluation.ranking import Ranking as Ranking
    from coclo_vio.fusion.feedback import Feedback as Feedback
    from coclo_vio.fusion.feedback import FeedbackPolicy as FeedbackPolicy
    from coclo_vio.fusion.feedback import PolicyParameters as PolicyParameters
    from coclo_vio.fusion.feedback import register_feedback_policy as register_feedback_policy
    from coclo_vio.fusion.streaming import StreamingEstimator as StreamingEstimator
    from coclo_vio.online.guarded_estimator import GuardedEstimator as GuardedEstimator
    from coclo_vio.robot.contact import ContactConfig as ContactConfig
    from coclo_vio.robot.contact import ContactEstimator as ContactEstimator
    from coclo_vio.robot.contact import ContactState as ContactState
    from coclo_vio.robot.contact import register_contact_estimator as register_contact_estimator
    from coclo_vio.robot.description import RobotDescription as RobotDescription
    from coclo_vio.robot.description import load_robot as load_robot
    from coclo_vio.robot.description import robot_names as robot_names
    from coclo_vio.runs.equipment import Equipment as Equipment
    from coclo_vio.runs.inspection import Inspection as Inspection
    from coclo_vio.runs.latency import LatencyRecord as LatencyRecord
    from coclo_vio.runs.modes.mode import Compared as Compared
    from coclo_vio.runs.modes.mode import Mode as Mode
    from coclo_vio.runs.modes.mode import Need as Need
    from coclo_vio.runs.modes.registry import modes as modes
    from coclo_vio.runs.modes.registry import register_mode as register_mode
    from coclo_vio.runs.modes.registry import unregister_mode as unregister_mode
    from coclo_vio.runs.run_config import RunConfig as RunConfig
    from coclo_vio.runs.run_folder import Existing as Existing
    from coclo_vio.runs.run_folder import RecordedTrajectory as RecordedTrajectory
    from coclo_vio.runs.run_record import RunRecord as RunRecord
    from coclo_vio.runs.running import Ending as Ending
    from coclo_vio.runs.stop_request import RunStopped as RunStopped
    from coclo_vio.runs.stop_request import StopRequest as StopRequest
    from coclo_vio.values.calibration import CameraCalibration as CameraCalibration
    from coclo_vio.values.calibration import ImuCalibration as ImuCalibration
    from coclo_vio.values.calibration import SensorCalibrations as SensorCalibrations
    from coclo_vio.values.calibration import StereoCalibration as StereoCalibration
    from coclo_vio.values.errors import CalibrationMissing as CalibrationMissing
    from coclo_vio.values.errors import CocloError as CocloError
    from coclo_vio.values.errors import ConfigError as ConfigError
    from coclo_vio.values.errors import DatasetError as DatasetError
    from coclo_vio.values.errors import EvaluationError as EvaluationError
    from coclo_vio.values.errors import FilterError as FilterError
    from coclo_vio.values.errors import RobotModelError as RobotModelError
    from coclo_vio.values.errors import SmootherError as SmootherError
    from coclo_vio.values.errors import TimestampError as TimestampError
    from coclo_vio.values.errors import TopicNotFound as TopicNotFound
    from coclo_vio.values.estimates import FootState as FootState
    from coclo_vio.values.estimates import NavState as NavState
    from coclo_vio.values.estimates import StateEstimate as StateEstimate
    from coclo_vio.values.keyframes import KeyframeResult as KeyframeResult
    from coclo_vio.values.keyframes import OdometryDelta as OdometryDelta
    from coclo_vio.values.keyframes import PoseEvidence as PoseEvidence
    from coclo_vio.values.keyframes import PoseMarginal as PoseMarginal
    from coclo_vio.values.keyframes import PosePair as PosePair
    from coclo_vio.values.measurements import BodyTwistSample as BodyTwistSample
    from coclo_vio.values.measurements import CameraImuSample as CameraImuSample
    from coclo_vio.values.measurements import FootForceSample as FootForceSample
    from coclo_vio.values.measurements import ImuSample as ImuSample
    from coclo_vio.values.measurements import JointSample as JointSample
    from coclo_vio.values.measurements import Measurement as Measurement
    from coclo_vio.values.measurements import StereoFrame as StereoFrame
    from coclo_vio.values.measurements import StereoTracks as StereoTracks
    from coclo_vio.values.outputs import Calibration as Calibration
    from coclo_vio.values.outputs import Estimate as Estimate
    from coclo_vio.values.outputs import Estimator as Estimator
    from coclo_vio.values.outputs import Event as Event
    from coclo_vio.values.outputs import Innovation as Innovation
    from coclo_vio.values.outputs import KeyframeHealth as KeyframeHealth
    from coclo_vio.values.outputs import Output as Output
    from coclo_vio.values.outputs import Picture as Picture
    from coclo_vio.values.outputs import Status as Status
    from coclo_vio.values.outputs import StreamStatus as StreamStatus
    from coclo_vio.values.outputs import WindowSnapshot as WindowSnapshot
    from coclo_vio.values.trajectory import GroundTruth as GroundTruth
    from coclo_vio.values.trajectory import Trajectory as Trajectory
    from coclo_vio.values.trajectory import read_tum as read_tum
    from coclo_vio.values.trajectory import write_tum as write_tum
    from coclo_vio.values.trajectory_kind import TrajectoryKind as TrajectoryKind
    from coclo_vio.views.view import View as View
