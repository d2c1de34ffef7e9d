"""One rig in the layout of every kind of calibration file, each written by hand after its documentation."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.types import Calibration, CameraIntrinsics, Distortion, FloatArray, ImuNoise

Writer = Callable[[Path, Calibration], tuple[Path, Path | None]]

RATE_HZ = 250.0
#: A second camera, in the files that can hold several: another size, topic and place.
_OTHER = {"size": (752, 480), "topic": "/cam1/image_raw"}


def make_rig(
    distortion: Distortion = Distortion.RADTAN,
    rotation: FloatArray | None = None,
    translation: tuple[float, float, float] = (0.0067, -0.0007, 0.0342),
    shift_ns: int = 2_400_000,
) -> Calibration:
    """A DAVIS-like rig; `rotation` is a rotation vector (3,) of the camera in the body [rad]."""
    coefficients = {
        Distortion.NONE: (),
        Distortion.RADTAN: (-0.37, 0.15, -3e-4, -7e-4),
        Distortion.EQUIDISTANT: (-0.05, 0.012, -0.004, 0.0007),
    }[distortion]
    T_b_c = np.eye(4)
    T_b_c[:3, :3] = Rotation.from_rotvec([0.3, -1.2, 0.7] if rotation is None else rotation).as_matrix()
    T_b_c[:3, 3] = translation
    return Calibration(
        CameraIntrinsics(199.1, 198.7, 120.3, 90.9, 240, 180, distortion, coefficients),
        T_b_c,
        shift_ns,
        ImuNoise(1.1e-4, 1.4e-3, 2.2e-6, 8.6e-5, RATE_HZ),
    )


def _rows(T: FloatArray) -> str:
    return "".join(f"    - [{', '.join(map(repr, row))}]\n" for row in T.tolist())


def _flat(T: FloatArray) -> str:
    return ", ".join(map(repr, T.ravel().tolist()))


def _list(values: tuple[float, ...]) -> str:
    return f"[{', '.join(map(repr, values))}]"


def _kalibr_camera(rig: Calibration, extrinsics: str) -> str:
    c = rig.camera
    return (
        f"{extrinsics}"
        "  camera_model: pinhole\n"
        f"  distortion_coeffs: {_list(c.coefficients)}\n"
        f"  distortion_model: {c.distortion}\n"
        f"  intrinsics: [{c.fx!r}, {c.fy!r}, {c.cx!r}, {c.cy!r}]\n"
        f"  resolution: [{c.width}, {c.height}]\n"
        "  rostopic: /dvs/image_raw\n"
        f"  timeshift_cam_imu: {rig.timeshift_ns / 1e9!r}\n"
    )


def _kalibr_noise(rig: Calibration, indent: str = "") -> str:
    n = rig.noise
    return (
        f"{indent}accelerometer_noise_density: {n.accelerometer_density!r}  #continuous-time\n"
        f"{indent}accelerometer_random_walk: {n.accelerometer_walk!r}\n"
        f"{indent}gyroscope_noise_density: {n.gyroscope_density!r}\n"
        f"{indent}gyroscope_random_walk: {n.gyroscope_walk!r}\n"
        f"{indent}rostopic: /dvs/imu\n"
        f"{indent}update_rate: {RATE_HZ}\n"
    )


def _write(folder: Path, name: str, text: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name).write_text(text)
    return folder / name


def kalibr(folder: Path, rig: Calibration) -> tuple[Path, Path | None]:
    """Kalibr: T_cam_imu."""
    inverse = np.linalg.inv(rig.T_b_c)
    inverse[3] = [0.0, 0.0, 0.0, 1.0]
    chain = "cam0:\n" + _kalibr_camera(rig, f"  T_cam_imu:\n{_rows(inverse)}")
    return _write(folder, "chain.yaml", chain), _write(folder, "noise.yaml", _kalibr_noise(rig))


def kalibr_second_of_two(folder: Path, rig: Calibration) -> tuple[Path, Path | None]:
    """Kalibr: the camera is cam1, whose place is known from cam0 alone; cam0 has another size and lens."""
    T_b_c0 = np.eye(4)
    T_b_c0[:3, :3] = Rotation.from_rotvec([-0.4, 0.2, 1.0]).as_matrix()
    T_b_c0[:3, 3] = [0.05, 0.02, -0.01]
    T_c0_b, T_c1_c0 = np.linalg.inv(T_b_c0), np.linalg.inv(rig.T_b_c) @ T_b_c0
    for T in (T_c0_b, T_c1_c0):
        T[3] = [0.0, 0.0, 0.0, 1.0]
    width, height = _OTHER["size"]
    text = (
        f"cam0:\n  T_cam_imu:\n{_rows(T_c0_b)}  camera_model: omni\n  resolution: [{width}, {height}]\n"
        f"  rostopic: {_OTHER['topic']}\ncam1:\n" + _kalibr_camera(rig, f"  T_cn_cnm1:\n{_rows(T_c1_c0)}")
    )
    return _write(folder, "chain.yaml", text), _write(folder, "noise.yaml", _kalibr_noise(rig))


def openvins(folder: Path, rig: Calibration) -> tuple[Path, Path | None]:
    """OpenVINS: OpenCV's header, T_imu_cam, both files named by the configuration."""
    chain = "%YAML:1.0\n\ncam0:\n" + _kalibr_camera(rig, f"  T_imu_cam: #R_CtoI, p_CinI\n{_rows(rig.T_b_c)}")
    noise = f"%YAML:1.0\n\nimu0:\n  T_i_b:\n{_rows(np.eye(4))}{_kalibr_noise(rig, '  ')}"
    noise += f"  model: kalibr\n  Tw:\n{_rows(np.eye(3))}  Tg:\n{_rows(np.zeros((3, 3)))}"
    _write(folder, "kalibr_imucam_chain.yaml", chain)
    _write(folder, "kalibr_imu_chain.yaml", noise)
    text = (
        '%YAML:1.0 # need to specify the file type at the top!\n\nverbosity: "INFO"\n\n'
        "init_dyn_bias_g: [ 0.0, 0.0, 0.0 ]\n"
        'relative_config_imu: "kalibr_imu_chain.yaml"\nrelative_config_imucam: "kalibr_imucam_chain.yaml"\n'
    )
    return _write(folder, "estimator_config.yaml", text), None


def rpg(folder: Path, rig: Calibration) -> tuple[Path, Path | None]:
    """rpg: T_B_C, delay_imu_cam = camera's stamp less the IMU's."""
    c, n = rig.camera, rig.noise
    name = {"none": "none", "radtan": "radial-tangential", "equidistant": "equidistant"}[str(c.distortion)]
    text = (
        'label: "DAVIS"\nid: a0652606b3d9fd6b62f5448a9e1304be\ncameras:\n- camera:\n    label: dvs\n'
        "    line-delay-nanoseconds: 0\n"
        f"    image_height: {c.height}\n    image_width: {c.width}\n    type: pinhole\n    intrinsics:\n"
        f"      cols: 1\n      rows: 4\n      data: [{c.fx!r}, {c.fy!r}, {c.cx!r}, {c.cy!r}]\n"
        f"    distortion:\n      type: {name}\n      parameters:\n        cols: 1\n        rows: 4\n"
        f"        data: {_list(c.coefficients)}\n"
        f"  T_B_C:\n    cols: 4\n    rows: 4\n    data: [{_flat(rig.T_b_c)}]\n"
        "imu_params:\n"
        f"  delay_imu_cam: {-rig.timeshift_ns / 1e9!r}\n  max_imu_delta_t: 0.01\n"
        f"  sigma_omega_c: {n.gyroscope_density!r}\n  sigma_acc_c: {n.accelerometer_density!r}\n"
        f"  sigma_omega_bias_c: {n.gyroscope_walk!r}\n  sigma_acc_bias_c: {n.accelerometer_walk!r}\n"
        f"  g: 9.8082\n  imu_rate: {RATE_HZ}\n"
    )
    return _write(folder, "rig.yaml", text), None


def _vins_noise(rig: Calibration) -> str:
    n, root = rig.noise, math.sqrt(RATE_HZ)
    return (
        f"acc_n: {n.accelerometer_density * root!r}   # accelerometer measurement noise standard deviation.\n"
        f"gyr_n: {n.gyroscope_density * root!r}\nacc_w: {n.accelerometer_walk * root!r}\n"
        f"gyr_w: {n.gyroscope_walk * root!r}\ng_norm: 9.81007\n"
        f"td: {rig.timeshift_ns / 1e9!r}   # readed image clock + td = real image clock (IMU clock)\n"
    )


def _vins_lens(rig: Calibration) -> str:
    c = rig.camera
    head = f"camera_name: camera\nimage_width: {c.width}\nimage_height: {c.height}\n"
    if c.distortion is Distortion.EQUIDISTANT:
        k = c.coefficients
        return (
            f"model_type: KANNALA_BRANDT\n{head}projection_parameters:\n"
            f"   k2: {k[0]!r}\n   k3: {k[1]!r}\n   k4: {k[2]!r}\n   k5: {k[3]!r}\n"
            f"   mu: {c.fx!r}\n   mv: {c.fy!r}\n   u0: {c.cx!r}\n   v0: {c.cy!r}\n"
        )
    k = c.coefficients or (0.0, 0.0, 0.0, 0.0)
    return (
        f"model_type: PINHOLE\n{head}distortion_parameters:\n"
        f"   k1: {k[0]!r}\n   k2: {k[1]!r}\n   p1: {k[2]!r}\n   p2: {k[3]!r}\n"
        f"projection_parameters:\n   fx: {c.fx!r}\n   fy: {c.fy!r}\n   cx: {c.cx!r}\n   cy: {c.cy!r}\n"
    )


def vins_mono(folder: Path, rig: Calibration) -> tuple[Path, Path | None]:
    """VINS-Mono: one file, rotation and translation apart; figures of a sample, without their rate."""
    R, t = rig.T_b_c[:3, :3], rig.T_b_c[:3, 3]
    text = (
        '%YAML:1.0\n\n#common parameters\nimu_topic: "/dvs/imu"\nimage_topic: "/dvs/image_raw"\n'
        f'output_path: "~/output/"\n\n{_vins_lens(rig)}\nestimate_extrinsic: 0\n'
        "#Rotation from camera frame to imu frame, imu^R_cam\nextrinsicRotation: !!opencv-matrix\n"
        f"   rows: 3\n   cols: 3\n   dt: d\n   data: [{_flat(R)}]\n"
        "extrinsicTranslation: !!opencv-matrix\n"
        f"   rows: 3\n   cols: 1\n   dt: d\n   data: [{_flat(t)}]\n{_vins_noise(rig)}"
    )
    return _write(folder, "davis_config.yaml", text), None


def vins_fusion(folder: Path, rig: Calibration) -> tuple[Path, Path | None]:
    """VINS-Fusion: body_T_cam0, the lens in a file of its own."""
    _write(folder, "cam0_pinhole.yaml", f"%YAML:1.0\n---\n{_vins_lens(rig)}")
    text = (
        '%YAML:1.0\n\nimu: 1\nnum_of_cam: 1\nimu_topic: "/dvs/imu"\nimage0_topic: "/dvs/image_raw"\n'
        'cam0_calib: "cam0_pinhole.yaml"\n'
        f"image_width: {rig.camera.width}\nimage_height: {rig.camera.height}\nestimate_extrinsic: 0\n"
        "body_T_cam0: !!opencv-matrix\n"
        f"   rows: 4\n   cols: 4\n   dt: d\n   data: [{_flat(rig.T_b_c)}]\n{_vins_noise(rig)}"
    )
    return _write(folder, "davis_mono_imu_config.yaml", text), None


def basalt(folder: Path, rig: Calibration) -> tuple[Path, Path | None]:
    """Basalt: poses as quaternions, a frame camera first, noise an axis."""
    c, n = rig.camera, rig.noise
    quaternion = Rotation.from_matrix(rig.T_b_c[:3, :3]).as_quat().tolist()
    pose = dict(zip(("px", "py", "pz"), rig.T_b_c[:3, 3].tolist(), strict=True))
    pose |= dict(zip(("qx", "qy", "qz", "qw"), quaternion, strict=True))
    lens = {"fx": c.fx, "fy": c.fy, "cx": c.cx, "cy": c.cy}
    if c.distortion is Distortion.EQUIDISTANT:
        kind, lens = "kb4", lens | {f"k{i + 1}": k for i, k in enumerate(c.coefficients)}
    elif c.distortion is Distortion.RADTAN:
        kind = "pinhole-radtan8"
        names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
        lens = lens | dict(zip(names, (*c.coefficients, 0.0, 0.0, 0.0, 0.0), strict=True))
    else:
        kind = "pinhole"
    other = {"camera_type": "ds", "intrinsics": {"fx": 300.0, "fy": 300.0, "cx": 370.0, "cy": 240.0}}
    content = {
        "T_imu_cam": [{**pose, "px": 1.0}, pose],
        "intrinsics": [other, {"camera_type": kind, "intrinsics": lens}],
        "resolution": [list(_OTHER["size"]), [c.width, c.height]],
        "calib_accel_bias": [0.01, 0.02, 0.03] + [0.0] * 6,
        "calib_gyro_bias": [0.0] * 12,
        "imu_update_rate": RATE_HZ,
        "accel_noise_std": [n.accelerometer_density] * 3,
        "gyro_noise_std": [n.gyroscope_density] * 3,
        "accel_bias_std": [n.accelerometer_walk] * 3,
        "gyro_bias_std": n.gyroscope_walk,
        "cam_time_offset_ns": rig.timeshift_ns,
        "vignette": [],
    }
    return _write(folder, "calibration.json", json.dumps({"value0": content}, indent=4)), None


def euroc(folder: Path, rig: Calibration) -> tuple[Path, Path | None]:
    """EuRoC's sensor.yaml, which knows no time shift, and the IMU's."""
    c = rig.camera
    name = "radial-tangential" if c.distortion is Distortion.RADTAN else str(c.distortion)
    text = (
        "sensor_type: camera\ncomment: a camera\nT_BS:\n  cols: 4\n  rows: 4\n"
        f"  data: [{_flat(rig.T_b_c)}]\nrate_hz: 20\nresolution: [{c.width}, {c.height}]\n"
        f"camera_model: pinhole\nintrinsics: [{c.fx!r}, {c.fy!r}, {c.cx!r}, {c.cy!r}]\n"
        f"distortion_model: {name}\ndistortion_coefficients: {_list(c.coefficients)}\n"
    )
    noise = _kalibr_noise(rig).replace("update_rate", "rate_hz")
    imu = f"sensor_type: imu\nT_BS:\n  cols: 4\n  rows: 4\n  data: [{_flat(np.eye(4))}]\n{noise}"
    return _write(folder / "cam0", "sensor.yaml", text), _write(folder / "imu0", "sensor.yaml", imu)


KINDS: dict[str, Writer] = {
    "kalibr": kalibr,
    "kalibr, second of two": kalibr_second_of_two,
    "openvins": openvins,
    "rpg": rpg,
    "vins-mono": vins_mono,
    "vins-fusion": vins_fusion,
    "basalt": basalt,
    "euroc": euroc,
}
