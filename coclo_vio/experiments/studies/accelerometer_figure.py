# SPDX-License-Identifier: BSD-3-Clause
"""The accelerometers of body and camera in a stairs trial, touch-downs marked: ``docs/accelerometer_shocks.png``.

``python -m coclo_vio.experiments.studies.accelerometer_figure [PNG]``
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from coclo_vio.experiments.studies.touch_down_shocks import (
    deviations,
    excess_kurtosis,
    touch_down_peaks,
    touch_downs,
)
from coclo_vio.robot.description import load_robot
from coclo_vio.simulation.simulated_recording import SIMULATED_ROBOT, simulation_config
from coclo_vio.simulation.trial.sensors import EPOCH_NS
from coclo_vio.simulation.trial.trial import Trial, simulate
from coclo_vio.values.measurements import CameraImuSample, ImuSample
from coclo_vio.values.units import NS_PER_S

SEED = 7
SHOWN_S = (40.0, 48.0)
IMUS: tuple[tuple[str, type[ImuSample] | type[CameraImuSample]], ...] = (
    ("body IMU, 100 Hz", ImuSample),
    ("camera IMU, 200 Hz", CameraImuSample),
)
AXIS_COLOURS = ("tab:blue", "tab:orange", "tab:green")


def draw(trial: Trial) -> Figure:
    """Eight seconds on the stairs, one panel for each IMU."""
    figure = Figure(figsize=(8.0, 5.2), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    landed = touch_downs(trial)
    for panel, (title, kind) in zip(panels, IMUS, strict=True):
        stamps, values = deviations(trial, kind)
        time_s = (stamps - EPOCH_NS) / NS_PER_S
        shown = (time_s >= SHOWN_S[0]) & (time_s <= SHOWN_S[1])
        tails = excess_kurtosis(values)
        for axis in range(3):
            label = f"{'xyz'[axis]}: excess kurtosis {tails[axis]:.1f}"
            panel.plot(time_s[shown], values[shown, axis], color=AXIS_COLOURS[axis], linewidth=0.8, label=label)
        for stamp_ns in landed:
            panel.axvline((stamp_ns - EPOCH_NS) / NS_PER_S, color="0.6", linewidth=0.8, linestyle=":", zorder=0)
        peak = float(np.median(touch_down_peaks(stamps, values, landed)))
        panel.set_title(f"{title}; median peak at touch-down {peak:.1f} m/s$^2$", fontsize=10, loc="left")
        panel.set_ylabel("specific force less\nits mean over 1 s [m/s$^2$]", fontsize=9)
        panel.legend(fontsize=8, ncols=3, loc="upper right")
        low, high = panel.get_ylim()
        panel.set_ylim(low, high + 0.25 * (high - low))
    panels[0].set_xlim(*SHOWN_S)
    panels[1].set_xlabel("time [s]; dotted: a foot touches down")
    return figure


if __name__ == "__main__":
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("docs/accelerometer_shocks.png")
    figure = draw(simulate("stairs", load_robot(SIMULATED_ROBOT), simulation_config("stairs").trial, SEED))
    FigureCanvasAgg(figure).print_figure(path, dpi=100, metadata={"Software": None})
