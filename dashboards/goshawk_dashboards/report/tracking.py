"""How well the vehicle did what was asked of it, and how near its limits it flew. None: the log does not tell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from goshawk_dashboards.charts.derived import DERIVED, thrust_limits
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.state.views import Array

AT_LIMIT = 0.005
"""Of full thrust: nearer to a limit is at it."""
SHAKING_HZ = 20.0
"""What is faster is not flown but vibrates."""
STRETCH_S = 1.0
"""Of a spectrum: it tells 1 Hz apart."""


@dataclass(frozen=True, kw_only=True)
class Tracking:
    """While its motors pushed."""

    attitude_rms_deg: float | None
    thrust_at_limit_fraction: float | None
    """Of the time; by the limits of the vehicle file."""
    battery_start_fraction: float | None
    battery_end_fraction: float | None
    odometry_doubt_most: float | None
    """The odometry's greatest check over its gate: from 1 on it fails."""
    vibration_rms_mps2: float | None
    """Above SHAKING_HZ, of all axes together, by the autopilot's IMU."""
    target_within_2_sigma_fraction: float | None
    """How often the target's true place was within twice the filter's own σ; a simulator's log only."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectrum:
    """What the IMU felt by frequency. Shape suffixes: F frequencies, 3 the body's axes."""

    hz_F: Array
    force_mps2_F3: Array
    """Amplitude density, m/s² a root Hz."""
    rate_rps_F3: Array


def tracking(flight: Flight, spectrum: Spectrum | None) -> Tracking:
    """Reads the whole flight."""
    control = flight.columns("control", ["thrust_n", "thrust_norm", "odometry_doubt"])
    pushing = control["thrust_n"] > 0.0
    _, error = DERIVED["attitude error"].read(flight)
    error = error[pushing & np.isfinite(error)]
    battery = flight.columns("controller_input", ["battery"])["battery"]
    battery = battery[np.isfinite(battery)]
    doubt = control["odometry_doubt"][np.isfinite(control["odometry_doubt"])]
    return Tracking(
        attitude_rms_deg=float(np.sqrt(np.mean(error**2))) if len(error) else None,
        thrust_at_limit_fraction=_at_limit(flight, control["thrust_norm"][pushing]),
        battery_start_fraction=float(battery[0]) if len(battery) else None,
        battery_end_fraction=float(battery[-1]) if len(battery) else None,
        odometry_doubt_most=float(doubt.max()) if len(doubt) else None,
        vibration_rms_mps2=None if spectrum is None else _shaking(spectrum),
        target_within_2_sigma_fraction=_within_2_sigma(flight),
    )


def _at_limit(flight: Flight, thrust_M: NDArray[np.float64]) -> float | None:
    limits = thrust_limits(flight)
    if limits is None or len(thrust_M) == 0:
        return None
    least, most = limits
    return float(np.mean((thrust_M <= least + AT_LIMIT) | (thrust_M >= most - AT_LIMIT)))


def _within_2_sigma(flight: Flight) -> float | None:
    error_s, error = DERIVED["error of the target's place"].read(flight)
    sigma_s, sigma = DERIVED["σ of the target's place"].read(flight)
    known = np.isfinite(sigma)
    if len(error) == 0 or not known.any():
        return None
    return float(np.mean(error <= 2.0 * np.interp(error_s, sigma_s[known], sigma[known])))


def spectrum_of(flight: Flight) -> Spectrum | None:
    """Of the time in the air; None if the log has no IMU, or less than three stretches of it."""
    imu = flight.columns("imu", ["specific_force_body", "ang_vel_body"])
    control = flight.columns("control", ["thrust_n"])
    pushing_s = control.times_s[control["thrust_n"] > 0.0]
    if len(pushing_s) < 2 or len(imu) < 2:
        return None
    flown = (imu.times_s >= pushing_s[0]) & (imu.times_s <= pushing_s[-1])
    times_s = imu.times_s[flown]
    every_s = float(np.median(np.diff(times_s))) if len(times_s) > 1 else 0.0
    samples = round(STRETCH_S / every_s) if every_s > 0.0 else 0
    if samples < 8 or len(times_s) < 3 * samples:
        return None
    return Spectrum(
        hz_F=np.arange(samples // 2 + 1) / (samples * every_s),
        force_mps2_F3=_density(imu["specific_force_body"][flown], samples, every_s),
        rate_rps_F3=_density(imu["ang_vel_body"][flown], samples, every_s),
    )


def _density(values_M3: NDArray[np.float64], samples: int, every_s: float) -> Array:
    """Welch's: the mean over stretches that overlap by half, each without its mean and under a Hann window."""
    window = np.hanning(samples)[:, None]
    starts = range(0, len(values_M3) - samples + 1, samples // 2)
    stretches = np.stack([values_M3[k : k + samples] for k in starts])
    stretches = stretches[np.isfinite(stretches).all(axis=(1, 2))]
    if len(stretches) == 0:
        return np.zeros((samples // 2 + 1, 3))
    stretches = (stretches - stretches.mean(axis=1, keepdims=True)) * window
    power = np.mean(np.abs(np.fft.rfft(stretches, axis=1)) ** 2, axis=0)
    return np.sqrt(2.0 * power * every_s / float((window**2).sum()))


def _shaking(spectrum: Spectrum) -> float:
    fast = spectrum.hz_F >= SHAKING_HZ
    wide_hz = float(spectrum.hz_F[1] - spectrum.hz_F[0])
    return float(np.sqrt((spectrum.force_mps2_F3[fast] ** 2).sum() * wide_hz))
