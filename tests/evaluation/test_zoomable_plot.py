# SPDX-License-Identifier: BSD-3-Clause
"""Zoomable plots are what plotly.js expects, hold the numbers of the curves, and stay small."""

import base64
import json

import numpy as np
import pytest

from coclo_vio.evaluation import plotly_page
from coclo_vio.evaluation.zoomable_plot import GROUND_TRUTH, ContactBands, Curve, ZoomablePlot, thinned
from coclo_vio.evaluation.zoomable_plots import (
    contacts_plot,
    error_bands_plot,
    keyframes_plot,
    path_plot,
    position_error_plot,
    positions_plot,
    velocities_plot,
)
from coclo_vio.values.trajectory import Trajectory


def unpacked(column: dict[str, str]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(column["bdata"]), dtype=column["dtype"])


@pytest.fixture
def truth(walk):
    return walk(np.arange(0.0, 20.0, 0.02))


@pytest.fixture
def near(truth):
    T = truth.T_world_body.copy()
    T[:, 2, 3] += 0.003 * truth.times_s
    return Trajectory(truth.stamps_ns, T, covariance=np.tile(1e-4 * np.eye(6), (len(truth), 1, 1)))


def test_every_plot_is_one_that_plotly_accepts(truth, near):
    graph_objects = pytest.importorskip("plotly.graph_objects")
    events = {"event: slip": [int(truth.stamps_ns[100])]}
    keyframes = {"legs": {name: np.array([1e9, 2e9]) for name in ("stamp_ns", "tracks", "reprojection_px")}}
    one, of = {"legs": near}, {"legs": truth}
    plots = [
        path_plot(one, truth),
        position_error_plot(one, of, events=events, start_ns=None),
        positions_plot(one, truth, start_ns=None),
        velocities_plot(one, truth, start_ns=None),
        error_bands_plot(one, of, start_ns=None, rotation_noise_rad=0.0, position_noise_m=0.0),
        keyframes_plot(keyframes, events=events, start_ns=None),
        contacts_plot(truth.stamps_ns, np.ones((len(truth), 2)), ["left", "right"], start_ns=None),
    ]
    for plot in plots:
        drawn = plot.drawn(3000)
        figure = graph_objects.Figure({"data": drawn["data"], "layout": drawn["layout"]})  # refuses unknown names
        assert len(figure.data) == len(drawn["data"]) > 0, plot.key
        for trace in drawn["data"]:
            assert trace.get("meta", "legs") in ("legs", GROUND_TRUTH)
    (line,) = plots[1].drawn(3000)["layout"]["shapes"]
    assert line["x0"] == pytest.approx(2.0, abs=1e-3)


def test_curves_hold_the_numbers_of_the_trajectory(truth, near):
    (error,) = position_error_plot({"legs": near}, {"legs": truth}, events={}, start_ns=None).drawn(5000)["data"]
    assert unpacked(error["y"])[500] == pytest.approx(1e3 * 0.003 * truth.times_s[500], rel=1e-3), "in mm"
    lower, upper, line = error_bands_plot(
        {"legs": near}, {"legs": truth}, start_ns=None, rotation_noise_rad=0.0, position_noise_m=0.0
    ).drawn(5000)["data"][6:9]
    assert np.allclose(unpacked(upper["y"]), 30.0, atol=1e-3), "three times a sigma of 10 mm"
    assert np.allclose(unpacked(lower["y"]), -30.0, atol=1e-3)
    assert unpacked(line["y"])[-1] == pytest.approx(3.0 * truth.times_s[-1], rel=1e-3)
    positions = positions_plot({"legs": near}, None, start_ns=None).drawn(5000)["data"]
    assert np.allclose(unpacked(positions[2]["y"]), near.positions[:, 2], atol=1e-5)


def test_thinning_keeps_extremes_ends_and_holes():
    values = np.sin(np.linspace(0.0, 30.0, 100_000))[:, None]
    values[54_321], values[77_000:77_010] = 9.0, np.nan
    kept = thinned(values, 1000)
    assert len(kept) <= 1010
    assert (np.diff(kept) > 0).all()
    assert {0, 54_321, 77_000, 99_999} <= set(kept.tolist())
    assert np.array_equal(thinned(values[:50], 1000), np.arange(50))


def test_bands_of_a_long_log_are_means_of_stretches():
    bands = ContactBands(np.arange(1000.0), np.repeat([[1.0, 0.0], [0.0, 0.0]], 500, axis=0), ["a", "b"])
    (heat,) = ZoomablePlot("contacts", "", ("",), ("t",), (52,), bands=bands).drawn(10)["data"]
    assert heat["z"]["shape"] == "2, 10"
    assert unpacked(heat["z"]).reshape(2, 10).tolist() == [[100] * 5 + [0] * 5, [0] * 10]


@pytest.mark.long
def test_the_data_of_long_recordings_stay_small():
    rng = np.random.default_rng(3)
    times = np.linspace(0.0, 3600.0, 30_000)
    curves = [Curve(f"t{index}", 0, times, rng.normal(size=len(times))) for index in range(120)]
    plot = ZoomablePlot("velocities", "", ("v",), ("time [s]",), (100,), curves)
    text = plotly_page._data([plot])
    assert len(text) <= 2_000_000
    assert len(json.loads(text)[0]["data"]) == 120


def test_boxes_begin_with_baselines_hidden_and_names_escaped(near):
    html = plotly_page.tick_boxes([path_plot({"coclo": near, "<b>": near}, near)])
    assert 'value="ground truth" checked' in html
    assert 'value="&lt;b&gt;">' in html or 'value="&lt;b&gt;" checked>' in html
