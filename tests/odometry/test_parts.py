"""Parts of the odometry: buffer, settings, dead reckoning, kernels compiled for the types in use."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from asyneio.config import Config
from asyneio.errors import CalibrationError
from asyneio.estimation.linearization import (
    corrections as correction_terms,
)
from asyneio.estimation.linearization import (
    interval as interval_terms,
)
from asyneio.estimation.linearization import (
    visual as visual_terms,
)
from asyneio.estimation.linearization.linear_system import linearize
from asyneio.estimation.problem.problem import States
from asyneio.inertial.noise import InertialNoise
from asyneio.odometry.buffer import MeasurementBuffer
from asyneio.odometry.intervals import around
from asyneio.odometry.learned_noise import LearnedNoise
from asyneio.odometry.propagation import predict_knot, propagate, rates_at
from asyneio.odometry.settings import resolve
from asyneio.pipeline import kernels
from asyneio.simulation import PinholeCamera
from asyneio.simulation.tracks.scenario import NOISE_FREE
from asyneio.trajectory.model import SE3, SO3_X_R3, WNOA, WNOJ, MotionModel
from asyneio.types import INERTIAL_DTYPE, OBSERVATION_DTYPE, Packet, RecordArray
from tests.estimation.toy import make_toy
from tests.inertial.windows import declared_noise
from tests.odometry.runs import SCENARIO, configured, simulated

Array = NDArray[np.float64]
CAMERA = SCENARIO.camera
GRAVITY = np.array([0.0, 0.0, -9.81])


def observed(t_ns: list[int], pixels: Array) -> RecordArray:
    records = np.zeros(len(t_ns), dtype=OBSERVATION_DTYPE)
    records["t_ns"], records["id"] = t_ns, np.arange(len(t_ns))
    records["u"], records["v"] = pixels.T
    return records


def stamped(*t_ns: int) -> RecordArray:
    records = np.zeros(len(t_ns), dtype=INERTIAL_DTYPE)
    records["t_ns"] = t_ns
    return records


def filled(pixels: Array, pixel_sigma: float = 0.5) -> MeasurementBuffer:
    buffer = MeasurementBuffer(CAMERA, pixel_sigma)
    times = list(range(100, 100 + len(pixels)))
    buffer.append(Packet(200, observed(times, pixels), stamped(90, 130, 150), stamped(100, 180)))
    return buffer


def pixels_and_rays(rng: np.random.Generator) -> tuple[Array, Array]:
    """Distorted pixels by the simulator's camera, and the normalised coordinates they come from."""
    xy = rng.uniform([-0.5, -0.4], [0.4, 0.3], (40, 2))
    pixels, _ = PinholeCamera.from_intrinsics(CAMERA).project(np.column_stack([xy, np.ones(40)]))
    return pixels, xy


def test_the_buffer_undistorts_observations(rng: np.random.Generator) -> None:
    pixels, xy = pixels_and_rays(rng)
    seen = filled(pixels).observations
    np.testing.assert_allclose(seen.xy, xy, atol=1e-8)
    np.testing.assert_array_equal(seen.track, np.arange(40))
    np.testing.assert_array_equal(seen.t_ns, np.arange(100, 140))


def test_whitened_errors_are_pixels_over_sigma(rng: np.random.Generator) -> None:
    pixels, _ = pixels_and_rays(rng)
    step = 1e-3 * rng.normal(size=pixels.shape)
    seen, moved = filled(pixels, 0.25).observations, filled(pixels + step, 0.25).observations
    whitened = np.einsum("nij,nj->ni", seen.root_information, moved.xy - seen.xy)
    np.testing.assert_allclose(whitened, step / 0.25, atol=1e-6)


def test_observations_without_a_ray_are_counted() -> None:
    pixels = np.array([[100.0, 90.0], [np.nan, 90.0], [1e7, 90.0], [120.0, 80.0]])
    buffer = filled(pixels)
    np.testing.assert_array_equal(buffer.observations.track, [0, 3])
    assert buffer.invalid == 2


def test_the_buffer_grows_and_forgets(rng: np.random.Generator) -> None:
    pixels, _ = pixels_and_rays(rng)
    buffer = filled(pixels)
    buffer.append(Packet(300, observed([210, 220], pixels[:2]), stamped(210, 250), stamped(260)))
    assert buffer.end_ns == 300
    np.testing.assert_array_equal(buffer.gyroscope["t_ns"], [90, 130, 150, 210, 250])
    assert len(buffer.observations.t_ns) == 42
    buffer.drop_until(210)
    # Four samples at or before the instant stay, for what follows; observations up to it are gone.
    np.testing.assert_array_equal(buffer.gyroscope["t_ns"], [90, 130, 150, 210, 250])
    np.testing.assert_array_equal(buffer.accelerometer["t_ns"], [100, 180, 260])
    np.testing.assert_array_equal(buffer.observations.t_ns, [220])
    for column in (buffer.observations.track, buffer.observations.xy, buffer.observations.root_information):
        assert len(column) == 1


def test_samples_of_an_interval_come_with_a_few_before_it() -> None:
    samples = stamped(1, 2, 3, 4, 5, 10, 20, 30, 40)
    np.testing.assert_array_equal(around(samples, 10, 30)["t_ns"], [3, 4, 5, 10, 20, 30])
    np.testing.assert_array_equal(around(samples, 9, 10)["t_ns"], [2, 3, 4, 5, 10])
    np.testing.assert_array_equal(around(samples, 0, 2)["t_ns"], [1, 2])


def learned(config: Config) -> InertialNoise:
    """The noise of the simulated sensors after a tenth of a second: declared, at their rates."""
    recording = simulated().recording
    noise = LearnedNoise(config.inertial, recording.calibration.noise, 0.1)
    noise.append(recording.gyroscope[:100], recording.accelerometer[:19])
    noise.learn_until(recording.gyroscope["t_ns"][-1])
    return noise.now()


def test_noise_of_a_sample_follows_its_rate() -> None:
    calibration = simulated().recording.calibration
    plain = configured()
    noise = calibration.noise
    known = learned(plain)
    settings = resolve(plain, calibration, known)
    first, second = settings.window.noise.gyroscope, settings.window.noise.accelerometer
    assert (first.density, second.density) == (noise.gyroscope_density, noise.accelerometer_density)
    assert first.rate_hz == pytest.approx(SCENARIO.gyroscope_rate_hz, rel=1e-3)
    assert second.rate_hz == pytest.approx(SCENARIO.accelerometer_rate_hz, rel=1e-3)
    np.testing.assert_allclose(settings.window.bias_walk[:3], noise.gyroscope_walk)
    np.testing.assert_allclose(settings.window.bias_walk[3:], noise.accelerometer_walk)
    wary = configured(inertial={"noise_inflation": 3.0, "walk_inflation": 5.0})
    known = learned(wary)
    trusted_less = resolve(wary, calibration, known)
    assert trusted_less.window.noise_inflation == 3.0
    assert trusted_less.window.noise.gyroscope.density == pytest.approx(3.0 * noise.gyroscope_density)
    assert trusted_less.window.bias_walk[4] == pytest.approx(5.0 * settings.window.bias_walk[4])
    assert settings.knot_interval_ns == 100_000_000
    np.testing.assert_array_equal(settings.window.gravity_w, GRAVITY)
    # Pixels become angles through the focal length.
    assert settings.window.bearing_sigma == pytest.approx(plain.visual.pixel_sigma / 199.0, rel=1e-3)


@pytest.mark.parametrize(
    ("kind", "densities"), [("wnoj", [2.0, 3.0]), ("wnoa", [4.0, 5.0])], ids=["wnoj", "wnoa"]
)
@pytest.mark.parametrize(("space", "number"), [("se3", SE3), ("so3xr3", SO3_X_R3)])
def test_motion_model_and_its_densities(kind: str, densities: list[float], space: str, number: int) -> None:
    given = {
        "angular_jerk_density": 2.0,
        "linear_jerk_density": 3.0,
        "angular_acceleration_density": 4.0,
        "linear_acceleration_density": 5.0,
    }
    config = configured(motion_prior={"kind": kind, "space": space, **given})
    window = resolve(
        config, simulated().recording.calibration, declared_noise(SCENARIO.noise, 200.0, 200.0)
    ).window
    assert window.motion_model == MotionModel(WNOJ if kind == "wnoj" else WNOA, number)
    np.testing.assert_array_equal(window.root_density, np.repeat(densities, 3))


@pytest.mark.parametrize(("estimate_bearing", "dof"), [(True, 3), (False, 1)])
def test_degrees_of_freedom_of_a_landmark(estimate_bearing: bool, dof: int) -> None:
    config = configured(visual={"estimate_bearing": estimate_bearing})
    assert (
        resolve(
            config, simulated().recording.calibration, declared_noise(SCENARIO.noise, 200.0, 200.0)
        ).window.landmark_dof
        == dof
    )


@pytest.mark.parametrize(
    ("scheme", "kind", "estimated"),
    [("gpif", "wnoj", 15), ("gpif", "wnoa", 0), ("gpp", "wnoj", 0), ("preint", "wnoj", 0)],
)
def test_where_the_scale_of_the_imu_is_estimated(scheme: str, kind: str, estimated: int) -> None:
    config = Config.model_validate({"inertial": {"scheme": scheme}, "motion_prior": {"kind": kind}})
    noise = declared_noise(SCENARIO.noise, 200.0, 200.0)
    window = resolve(config, simulated().recording.calibration, noise).window
    assert len(window.imu.columns) == estimated


def test_noise_free_calibration_is_rejected() -> None:
    calibration = replace(simulated().recording.calibration, noise=NOISE_FREE)
    with pytest.raises(CalibrationError, match="noise densities"):
        LearnedNoise(Config().inertial, calibration.noise, 0.1)


def test_walk_of_zero_stays_solvable() -> None:
    calibration = simulated().recording.calibration
    still = replace(calibration, noise=replace(calibration.noise, gyroscope_walk=0.0))
    assert (
        resolve(Config(), still, declared_noise(SCENARIO.noise, 200.0, 200.0)).window.bias_walk > 0.0
    ).all()


def noise_free() -> tuple[States, tuple[RecordArray, RecordArray], NDArray[np.int64]]:
    """True knots 50 ms apart, streams of different rates without noise, times of the knots."""
    simulation = simulated(
        0,
        noise=NOISE_FREE,
        initial_gyroscope_bias_sigma=0.0,
        initial_accelerometer_bias_sigma=0.0,
        gyroscope_rate_hz=1000.0,
        accelerometer_rate_hz=430.0,
    )
    t_ns = simulation.truth.start_ns + 1_000_000_000 + 50_000_000 * np.arange(4)
    truth = simulation.truth.at(t_ns)
    C = np.ascontiguousarray(truth.T_w_b[:, :3, :3])
    nu = np.einsum("nji,nj->ni", C, truth.velocity_w)
    velocity = np.hstack([truth.angular_velocity_b, nu])
    varpi = np.stack([velocity, truth.generalized_acceleration], axis=1)
    states = States(C, np.ascontiguousarray(truth.T_w_b[:, :3, 3]), varpi, np.zeros((4, 6)))
    return states, (simulation.recording.gyroscope, simulation.recording.accelerometer), t_ns


def test_next_knot_is_predicted() -> None:
    states, streams, t_ns = noise_free()
    for k in range(3):
        now = states.chosen(slice(k + 1))
        knot = predict_knot(now, int(t_ns[k]), int(t_ns[k + 1]), streams, GRAVITY)
        np.testing.assert_allclose(knot.C[0], states.C[k + 1], atol=1e-5)
        np.testing.assert_allclose(knot.r[0], states.r[k + 1], atol=1e-5)
        np.testing.assert_allclose(knot.varpi[0, 0], states.varpi[k + 1, 0], atol=2e-3)
        np.testing.assert_allclose(knot.varpi[0, 1, 3:], states.varpi[k + 1, 1, 3:], atol=0.05)
        np.testing.assert_allclose(knot.varpi[0, 1, :3], states.varpi[k + 1, 1, :3], atol=0.5)


def test_prediction_subtracts_the_biases() -> None:
    states, (gyroscope, accelerometer), t_ns = noise_free()
    bias = np.array([0.1, -0.2, 0.05, 0.3, 0.1, -0.4])
    biased = [stream.copy() for stream in (gyroscope, accelerometer)]
    biased[0]["xyz"] += bias[:3]
    biased[1]["xyz"] += bias[3:]
    first = states.chosen(slice(1))
    plain = predict_knot(first, int(t_ns[0]), int(t_ns[1]), (gyroscope, accelerometer), GRAVITY)
    again = predict_knot(
        first._replace(bias=bias[None]), int(t_ns[0]), int(t_ns[1]), (biased[0], biased[1]), GRAVITY
    )
    for a, b in zip(plain[:3], again[:3], strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12)
    np.testing.assert_array_equal(again.bias[0], bias)


def test_propagation_answers_at_the_times_asked() -> None:
    states, (gyroscope, accelerometer), t_ns = noise_free()
    asked = np.array([t_ns[0], t_ns[0] + 1_234_567, t_ns[3]])
    start = (states.C[0], states.r[0], states.C[0] @ states.varpi[0, 0, 3:])
    path = propagate(gyroscope, accelerometer, np.zeros(6), start, asked, GRAVITY)
    at = path.at(asked)
    np.testing.assert_array_equal(path.t_ns[at], asked)
    np.testing.assert_allclose(path.r[at[-1]], states.r[3], atol=1e-4)
    np.testing.assert_allclose(path.C[at[-1]], states.C[3], atol=1e-4)
    np.testing.assert_allclose(path.v[at[-1]], states.C[3] @ states.varpi[3, 0, 3:], atol=1e-3)


def test_rates_from_samples_on_both_sides() -> None:
    states, streams, t_ns = noise_free()
    v_w = states.C[1] @ states.varpi[1, 0, 3:]
    rates = rates_at(int(t_ns[1]), states.C[1], v_w, streams, np.zeros(6), GRAVITY, 5_000_000)
    np.testing.assert_allclose(rates[0], states.varpi[1, 0], atol=1e-3)
    np.testing.assert_allclose(rates[1], states.varpi[1, 1], atol=0.05)


def test_kernels_are_compiled_for_the_types_in_use() -> None:
    """Compiling ahead must give the very kernels that the window calls, or it is compiled twice."""
    problem, _ = make_toy(count=3, landmarks=4).problem()
    linearize(problem._replace(imu=problem.imu._replace(columns=np.arange(15))))
    watched = [
        correction_terms.add_correction.inner,
        visual_terms.visual_terms,
        interval_terms.accelerometer_terms,
        interval_terms.gyroscope_terms,
        interval_terms.motion_terms,
        interval_terms.interval_chains,
        interval_terms.interval_locals,
    ]
    before = [list(kernel.signatures) for kernel in watched]
    kernels.compile_intervals()
    kernels.compile_visual()
    assert [list(kernel.signatures) for kernel in watched] == before
    kernels.compile_frontend()
    assert kernels.are_compiled()
