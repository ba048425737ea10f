# SPDX-License-Identifier: BSD-3-Clause
"""Diagnostic figures: bands of stance, keyframes, and errors within the filter's sigmas."""

from dataclasses import replace

import numpy as np
import pytest

from coclo_vio.evaluation.diagnostic_figures import error_and_sigma, plot_contacts, plot_error_bands, plot_keyframes
from coclo_vio.evaluation.figure_style import save_png
from coclo_vio.geometry import se3, so3
from coclo_vio.values.errors import EvaluationError

matplotlib_image = pytest.importorskip("matplotlib.image", reason="figures need the extra `viz`")


def coloured(path, least: float = 0.2) -> int:
    """Pixels that are not grey; pale ones count where ``least`` is small."""
    assert path.read_bytes().startswith(b"\x89PNG")
    return int((np.ptp(matplotlib_image.imread(path)[..., :3], axis=2) > least).sum())


def test_contact_bands_show_stance(tmp_path):
    stamps_ns = np.arange(200) * 10_000_000
    standing = save_png(plot_contacts(stamps_ns, np.ones((200, 2)), ["FL", "FR"]), tmp_path / "stand.png")
    flying = save_png(plot_contacts(stamps_ns, np.zeros((200, 2)), ["FL", "FR"]), tmp_path / "fly.png")
    assert coloured(standing) > 10_000 > coloured(flying)
    with pytest.raises(EvaluationError, match=r"\(200, 3\)"):
        save_png(plot_contacts(stamps_ns, np.ones((200, 2)), ["FL", "FR", "RL"]), tmp_path / "wrong.png")


def test_keyframes_of_every_smoother_are_shown(tmp_path):
    def columns(level: float) -> dict[str, np.ndarray]:
        stamps_ns = 1e18 + np.arange(50) * 2e8
        return {"stamp_ns": stamps_ns, "tracks": np.full(50, 100 * level), "reprojection_px": np.full(50, level)}

    one = save_png(plot_keyframes({"vision": columns(1.0)}), tmp_path / "one.png")
    two = save_png(plot_keyframes({"vision": columns(1.0), "stereo": columns(0.5)}), tmp_path / "two.png")
    assert coloured(two) > coloured(one) > 100
    with pytest.raises(EvaluationError, match="there is none; run a visual mode first"):
        save_png(plot_keyframes({"vision": {"stamp_ns": np.zeros(0)}}), tmp_path / "none.png")


def test_errors_and_sigmas_are_in_the_axes_of_the_world(line):
    """A body that faces left: its forward error is the world's y, its roll is no yaw."""
    truth = line(1.0, seconds=1.0)
    left = se3.transform(so3.about_z(0.5 * np.pi), np.zeros(3))
    apart = se3.exp(np.array([0.0, 0.0, 0.02, 0.3, 0.0, 0.0]))
    covariance = np.tile(np.diag(np.array([0.5, 0.6, 0.1, 0.3, 0.02, 0.01]) ** 2), (len(truth), 1, 1))
    reference = replace(truth, T_world_body=truth.T_world_body @ left)
    estimate = replace(truth, T_world_body=truth.T_world_body @ left @ apart, covariance=covariance)
    error, sigma = error_and_sigma(estimate, reference)
    np.testing.assert_allclose(error, np.tile([0.0, 0.3, 0.0, 0.02], (len(truth), 1)), atol=4e-3)
    np.testing.assert_allclose(sigma, np.tile([0.02, 0.3, 0.01, 0.1], (len(truth), 1)), rtol=0.1)
    _, noisy = error_and_sigma(estimate, reference, rotation_noise_rad=0.1, position_noise_m=0.3)
    np.testing.assert_allclose(noisy[0, [1, 3]], [0.3 * np.sqrt(2.0), 0.1 * np.sqrt(2.0)], rtol=0.02)


def test_a_wider_band_covers_more(line, tmp_path):
    truth = line(1.0, seconds=1.0)

    def drawn(sigma_m: float, name: str) -> int:
        covariance = np.tile(np.eye(6) * sigma_m**2, (len(truth), 1, 1))
        off = truth.moved(se3.transform(np.eye(3), np.array([0.3, 0.0, 0.0])))
        estimate = replace(off, covariance=covariance)
        return coloured(save_png(plot_error_bands({"legs": estimate}, {"legs": truth}), tmp_path / name), 0.05)

    assert drawn(0.1, "wide.png") > 1.15 * drawn(0.001, "narrow.png")


def test_bands_need_a_covariance(line, tmp_path):
    with pytest.raises(EvaluationError, match="need the covariance"):
        save_png(plot_error_bands({"legs": line(1.0)}, {"legs": line(1.0)}), tmp_path / "bands.png")
    with pytest.raises(EvaluationError, match="at least one estimate"):
        save_png(plot_error_bands({}, {}), tmp_path / "bands.png")
