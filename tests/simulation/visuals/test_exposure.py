# SPDX-License-Identifier: BSD-3-Clause
import numpy as np
import pytest

from coclo_vio.simulation.visuals.config import CameraConfig, ExposureConfig
from coclo_vio.simulation.visuals.exposure import Exposure, exposures
from coclo_vio.values.errors import ConfigError
from coclo_vio.values.units import NS_PER_S

RATE_HZ = 15
STEADY = {"drift": 0.0}


def exposed(seconds: float, seed: int = 1, **config: object) -> list[Exposure]:
    stamps_ns = 7 * NS_PER_S + np.arange(round(seconds * RATE_HZ)) * (NS_PER_S // RATE_HZ)
    return exposures(stamps_ns, CameraConfig.parse(config, "camera"), seed)


def test_normal_light_has_the_nominal_exposure() -> None:
    nominal = ExposureConfig()
    for each in exposed(2.0, exposure=STEADY):
        assert (each.duration_s, each.gain) == pytest.approx((nominal.nominal_s, nominal.nominal_gain))
        assert each.brightness == pytest.approx(nominal.white_level)


def test_a_dark_room_is_exposed_long_and_amplified() -> None:
    setting = ExposureConfig()
    last = exposed(3.0, exposure=STEADY, lighting={"level": "dark"})[-1]
    assert last.duration_s == pytest.approx(setting.longest_s)
    assert last.gain == pytest.approx(20.0 * setting.nominal_s * setting.nominal_gain / setting.longest_s)
    assert last.brightness == pytest.approx(setting.white_level)
    darker = exposed(3.0, exposure=STEADY, lighting={"level": "dark", "dark_share": 0.005})[-1]
    assert darker.gain == pytest.approx(setting.largest_gain)
    assert darker.brightness < 0.2 * setting.white_level


def test_a_blackout_is_black_then_overexposed_then_over() -> None:
    blackouts = [{"start_s": 1.99, "duration_s": 1.0}]
    brightness = np.array(
        [each.brightness for each in exposed(6.0, exposure=STEADY, lighting={"blackouts": blackouts})]
    )
    white = ExposureConfig().white_level
    assert brightness[: 2 * RATE_HZ] == pytest.approx(white)
    assert brightness[2 * RATE_HZ : 3 * RATE_HZ].max() < 0.001
    assert brightness[3 * RATE_HZ] > 5.0 * white
    assert (np.diff(brightness[3 * RATE_HZ :]) <= 1e-9).all()
    assert brightness[-1] == pytest.approx(white, rel=1e-3)


def test_gain_drifts_slowly_and_stays_about_its_nominal_value() -> None:
    logs = np.log([each.gain for seed in range(20) for each in exposed(60.0, seed)]).reshape(20, -1)
    setting = ExposureConfig()
    assert logs.mean() == pytest.approx(np.log(setting.nominal_gain), abs=0.02)
    assert logs.std() == pytest.approx(setting.drift, rel=0.15)
    step = np.diff(logs, axis=1).std()
    assert step == pytest.approx(setting.drift * np.sqrt(2.0 / (RATE_HZ * setting.drift_time_s)), rel=0.1)


def test_same_seed_same_drift() -> None:
    assert exposed(2.0, seed=3) == exposed(2.0, seed=3)
    assert exposed(2.0, seed=3) != exposed(2.0, seed=4)


def test_limits_below_the_nominal_exposure_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"longest_s = 0.001 .* must not be below"):
        ExposureConfig.parse({"longest_s": 0.001}, "exposure")
