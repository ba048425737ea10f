# SPDX-License-Identifier: BSD-3-Clause
"""How fast the filter is, in figures: on an analytic trial of six legs, beside filterpy's in the same run.

Stands beside the pipeline: it sees the filter, the robot and the simulation, and nothing here prints. For one core,
set ``OPENBLAS_NUM_THREADS=1`` before Python starts.
"""

import importlib
import resource
import sys
import tracemalloc
from collections import Counter
from collections.abc import Callable, Iterator
from itertools import chain
from time import perf_counter
from typing import Any

import numpy as np

from coclo_vio.arrays import Array
from coclo_vio.errors import ConfigError
from coclo_vio.filter import observation, process
from coclo_vio.filter.config import FilterConfig, RobustConfig
from coclo_vio.filter.core import SquareRootFilter
from coclo_vio.filter.initialisation import initial_filter
from coclo_vio.filter.intake import Intake
from coclo_vio.filter.odometry import LegOdometryFilter
from coclo_vio.filter.paper import PaperProfile
from coclo_vio.filter.robust import RobustProfile
from coclo_vio.filter.stance import FootMotion, Reading
from coclo_vio.filter.state import LEG_SCALE, State
from coclo_vio.measurements import Measurement
from coclo_vio.robot.description import load_robot
from coclo_vio.robot.model import RobotModel
from coclo_vio.simulation.analytic import AnalyticTrialConfig, generate
from coclo_vio.simulation.body_motion import BodyMotionConfig
