# SPDX-License-Identifier: BSD-3-Clause
"""The zoomable plots of a run, those that it has data for."""

from collections.abc import Iterator

from coclo_vio.evaluation.zoomable_plot import ZoomablePlot
from coclo_vio.evaluation.zoomable_plots import (
    contacts_plot,
    error_bands_plot,
    keyframes_plot,
    path_plot,
    position_error_plot,
    positions_plot,
    velocities_plot,
)
from coclo_vio.runs.drawn_run import DrawnRun


def zoomable_plots(run: DrawnRun) -> list[ZoomablePlot]:
    """Every plot that the run has data for, in the order of a report.

    Raises:
        EvaluationError: there is no estimate.
    """
    return list(_plots(run))


def _plots(run: DrawnRun) -> Iterator[ZoomablePlot]:
    start_ns = run.start_ns
    yield path_plot(run.estimates, run.reference)
    if run.evaluations:
        yield position_error_plot(run.estimates, run.references, events=run.events, start_ns=start_ns)
    yield positions_plot(run.estimates, run.reference, start_ns=start_ns)
    yield velocities_plot(run.estimates, run.reference, start_ns=start_ns)
    if run.evaluations and run.with_covariance:
        yield error_bands_plot(
            run.with_covariance,
            run.references,
            start_ns=start_ns,
            rotation_noise_rad=run.config.ground_truth_rotation_noise_rad,
            position_noise_m=run.config.ground_truth_position_noise_m,
        )
    if run.keyframes:
        yield keyframes_plot(run.keyframes, events=run.events, start_ns=start_ns)
    feet = run.with_feet
    if feet is not None:
        yield contacts_plot(feet.trajectory.stamps_ns, feet.contact_probability, feet.leg_names, start_ns=start_ns)
