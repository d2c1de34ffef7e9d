"""Ground truth, trajectories, IMU exports, bags and calibrations: kinds F, G, H, I, J and K.

Some inertial files and one calibration are listed under other kinds in the cases' README (A, B, C, D).
"""

from __future__ import annotations

from case_expectations.step import Expectations, Step

#: Errors of the estimate of kind G, for all file formats.
_SAME = (r"ATE\) . 1\.750 cm", r"orientation error, RMSE . 0\.009 deg")
_USABLE = r"usable for asyneio run and asyneio track: 0 FAIL"
_DOCTOR = "asyneio doctor data"
_SAMPLES = "asyneio doctor data --samples data/imu.csv"
_TRACK = "asyneio track data -o out"
_TRACKS = ("out/tracks.csv",)
_CHAIN = "data/camchain-imucam.yaml"
#: Commands that apply the proposed fixes.
_FIX_SHIFT = f"sed -i 's/timeshift_cam_imu: 2.4/timeshift_cam_imu: 0.0024/' {_CHAIN}; "
_INDENT = "sed -i 's/^[a-z]/  &/; s/^  cam0/cam0/' data/flat.yaml; "
_NOISE = (
    r"printf 'gyroscope_noise_density: 4.7e-4\naccelerometer_noise_density: 4.7e-3\n"
    r"gyroscope_random_walk: 4.8e-5\naccelerometer_random_walk: 5.1e-4\nupdate_rate: 1000\n' > "
    r"data/noise.yaml; "
)

_TRUTH: Expectations = {
    "T01": (
        Step(_TRACK, files=_TRACKS, says=(r"skipped 80 line\(s\) without a pose",)),
        Step(
            _DOCTOR,
            says=(r"160 ground-truth poses", _USABLE),
            silent=(r"no inertial samples", r"calibration: none"),
        ),
    ),
    "T04": (
        Step(_TRACK, files=_TRACKS, says=(r"3 further column",)),
        Step(_DOCTOR, says=(r"240 ground-truth poses", _USABLE)),
    ),
    "Z06": (
        Step(_TRACK, files=_TRACKS, says=(r"not used as ground truth: .*groundtruth\.txt",)),
        Step(_DOCTOR, says=(r"groundtruth\.txt", _USABLE)),
    ),
}

_TRAJECTORIES: Expectations = {
    "V01": (Step("asyneio evaluate data/est.tum data/gt_euroc.csv", says=_SAME),),
    "V03": (Step("asyneio evaluate data/vins_result_no_loop.csv data/gt.tum", says=_SAME),),
    "V04": (Step("asyneio evaluate data/orb.txt data/gt.tum", says=(*_SAME, r"time in ns")),),
    "V06": (
        Step(
            "asyneio evaluate data/est_round.txt data/gt.tum",
            status=(1,), says=(r"too few digits", r"%\.9f"), silent=(r"add the offset",),
        ),
    ),
    "V07": (
        Step(
            "asyneio evaluate data/est.tum data/gt_nan.txt",
            says=(*_SAME, r"skipped 2000 line\(s\) without a pose"),
        ),
    ),
    "V08": (
        Step(
            "asyneio evaluate data/est_unsorted.tum data/gt.tum",
            says=(*_SAME, r"sorted by time"), silent=(r"reset",),
        ),
    ),
    "V13": (
        Step("asyneio evaluate data/est.tum data/gt_1hz.tum", status=(1,), says=(r"--max-gap 1\.1",)),
        Step(
            "asyneio evaluate data/est.tum data/gt_1hz.tum --max-gap 1.1",
            own=True, says=(r"ATE\) . \d\.",),
        ),
    ),
    "V16": (
        Step("asyneio evaluate data/est.tum data/gt_mm.tum", says=(r"1000 times as large.*millimetres\?",)),
    ),
    "V19": (Step("asyneio evaluate data/est.tum data/mocap_data.txt", says=(*_SAME, r"time in us")),),
}  # fmt: skip

_SAMPLE_FILES: Expectations = {
    "I02": (
        Step(_SAMPLES, says=(r"in g: multiplied", r"fits a gyroscope in deg/s"), silent=(r": check\b",)),
    ),
    "I03": (Step(_SAMPLES, says=(r"\(from the header\), time in ns", _USABLE)),),
    "I05": (Step(_SAMPLES, says=(r"commas read as decimal points", _USABLE)),),
    "I18": (
        Step(_SAMPLES, status=(1,), says=(r"'2020-09-13T12:26:40", r"times must be numbers")),
    ),
    "I21": (Step(_DOCTOR, says=(r"gyroscope first \(from the header\), time in ns", _USABLE)),),
    "I22": (
        Step(
            _SAMPLES,
            says=(r"gyroscope in deg/s \(from the header\)", r"gyroscope 0\.2\d+ \(medians\)", r"0 FAIL"),
        ),
    ),
}  # fmt: skip

_BAGS: Expectations = {
    "B09": (
        Step(_DOCTOR, says=(r"1200 samples of the gyroscope, 300 samples of the accelerometer", r"0 FAIL")),
        Step(
            "asyneio doctor data --samples /camera/gyro/sample",
            status=(1,), says=(r"--samples /camera/gyro/sample,/camera/accel/sample",),
        ),
        Step(
            "asyneio doctor data --samples /camera/gyro/sample,/camera/accel/sample",
            own=True, says=(r"0 FAIL",),
        ),
    ),
    "B10b": (Step(_DOCTOR, says=(r"30 ground-truth poses", r"ground truth from the poses of /gt_path")),),
    "B15": (
        Step(
            _DOCTOR,
            says=(r"94992 events, 1200 samples", r"rec_0\.bag, rec_1\.bag are consecutive", _USABLE),
        ),
    ),
    "C01": (
        Step(_DOCTOR, says=(r"94992 events", r"0 FAIL")),
        Step(f"zstd -d -q data/*.db3.zstd; {_DOCTOR}", own=True, says=(r"94992 events", r"0 FAIL")),
        Step(f"rm data/*.zstd; {_DOCTOR}", own=True, says=(r"94992 events", r"0 FAIL")),
    ),
}  # fmt: skip

_CALIBRATIONS: Expectations = {
    "K02": (
        Step(
            "asyneio doctor data --calibration data/flat.yaml",
            status=(1,), says=(r"expected them below cam0:, indented",), silent=(r"is None",),
        ),
        Step(f"{_INDENT} asyneio doctor data --calibration data/flat.yaml", own=True, silent=(r"FAIL cal",)),
    ),
    "K05": (
        Step(
            "asyneio doctor data --calibration data/results-imucam.txt",
            status=(1,), says=(r"report of Kalibr", r"use camchain-imucam\.yaml"),
        ),
        Step(f"{_DOCTOR} --calibration {_CHAIN}", own=True, says=(_USABLE,)),
    ),
    "K08": (
        Step(
            "asyneio doctor data --calibration data/orb.yaml",
            says=(r"IMU\.T_b_c1 \(camera to body\)", r"calibration: 240 x 180, radtan, extrinsics", _USABLE),
        ),
    ),
    "K19": (
        Step(
            _DOCTOR, status=(1,),
            says=(r"timeshift_cam_imu is 2\.4", r"2\.4 ms are meant, write 0\.0024"), silent=(r"sideways",),
        ),
        Step(f"{_FIX_SHIFT} {_DOCTOR}", own=True, silent=(r"timeshift_cam_imu is", r"FAIL cal")),
    ),
    "K21": (
        Step(
            "asyneio doctor data --imu data/davis_imu_param.yaml",
            status=(1,), says=(r"imu_utils", r"gyroscope_noise_density: 0\.015", r"root of the IMU rate"),
        ),
        Step(f"{_NOISE} {_DOCTOR} --imu data/noise.yaml", own=True, says=(_USABLE,)),
    ),
    "K23": (
        Step(
            "asyneio doctor data --calibration data/dv.json",
            says=(r"transformationToC0 \(IMU to camera\)", r"time shift \+2\.4 ms, IMU noise"),
        ),
    ),
    "Z09": (
        Step(_DOCTOR, status=(1,), says=(r"camchain-imucam\.yaml is empty",), silent=(r"NoneType",)),
        Step(f"rm {_CHAIN}; {_DOCTOR}", own=True, silent=(r"is empty",)),
    ),
}  # fmt: skip

CASES: Expectations = {**_TRUTH, **_TRAJECTORIES, **_SAMPLE_FILES, **_BAGS, **_CALIBRATIONS}
