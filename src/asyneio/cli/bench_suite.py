# SPDX-License-Identifier: Apache-2.0
"""`asyneio bench SUITE`: the commands of all suites, and their options."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from asyneio.cli.bench_run import BenchRequest, run_bench
from asyneio.cli.options import (
    CameraOption,
    ConfigOption,
    TablesJsonOption,
    TrackerOption,
)

_Folder = Annotated[Path, typer.Argument(help="Folder with the sequences as they were downloaded.")]
_Output = Annotated[
    Path | None,
    typer.Option("--output", "-o", help="Folder for the results.", show_default="results/bench-SUITE"),
]
_Sequences = Annotated[
    str | None,
    typer.Option(help="Names, separated by commas.", show_default="those of the suite that exist"),
]
_Schemes = Annotated[
    str | None,
    typer.Option(help="Inertial schemes to compare, separated by commas.", show_default="as configured"),
]
_Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        help="Setting with values to compare: section.name=value,value. May be repeated.",
        metavar="KEY=VALUES",
    ),
]
_Seeds = Annotated[
    int, typer.Option(help="Number of random seeds; recorded data have one, as nothing is random.", min=1)
]
_FirstSeconds = Annotated[
    float | None, typer.Option(help="Use only this many seconds from the start.", min=1.0, show_default="all")
]
_Jobs = Annotated[
    int, typer.Option(help="Number of parallel processes; each run uses up to two cores.", min=1, max=64)
]
_Cluster = Annotated[
    str | None,
    typer.Option(
        help="Address of a Dask scheduler, such as tcp://host:8786: its workers run the jobs.",
        show_default="processes on this computer",
    ),
]
_CameraModel = Annotated[
    str | None,
    typer.Option(
        "--preset",
        help="Camera model whose published values fill gaps in the calibration; '' for none.",
        show_default="that of the suite",
    ),
]
_Calibration = Annotated[
    Path | None,
    typer.Option(help="Camera calibration file (any supported format).", show_default="of the data set"),
]
_Imu = Annotated[
    Path | None, typer.Option(help="IMU noise file (any supported format).", show_default="of the data set")
]


def _data_set_command(suite: str, what: str) -> Callable[..., None]:
    """The command of a data set; `what` begins its help."""

    def command(
        folder: _Folder,
        output: _Output = None,
        sequences: _Sequences = None,
        schemes: _Schemes = None,
        assignments: _Set = None,
        seeds: _Seeds = 1,
        seconds: _FirstSeconds = None,
        jobs: _Jobs = 1,
        cluster: _Cluster = None,
        preset: _CameraModel = None,
        calibration: _Calibration = None,
        imu: _Imu = None,
        camera: CameraOption = None,
        config: ConfigOption = None,
        tracker: TrackerOption = None,
        as_json: TablesJsonOption = False,
    ) -> None:
        run_bench(
            BenchRequest(
                suite, folder, output, sequences, schemes, assignments or [], seeds, seconds, jobs, cluster,
                config, tracker, as_json, preset, calibration, imu, camera,
            )
        )  # fmt: skip

    command.__doc__ = f"{what}.\n\n{_MORE}"
    return command


def _simulated_command(suite: str, what: str) -> Callable[..., None]:
    """The command of simulated recordings, which has no files."""

    def command(
        output: _Output = None,
        sequences: _Sequences = None,
        schemes: _Schemes = None,
        assignments: _Set = None,
        seeds: _Seeds = 1,
        seconds: _FirstSeconds = None,
        jobs: _Jobs = 1,
        cluster: _Cluster = None,
        config: ConfigOption = None,
        tracker: TrackerOption = None,
        as_json: TablesJsonOption = False,
    ) -> None:
        run_bench(
            BenchRequest(
                suite, None, output, sequences, schemes, assignments or [], seeds, seconds, jobs, cluster,
                config, tracker, as_json,
            )
        )  # fmt: skip

    command.__doc__ = f"{what}.\n\n{_MORE}"
    return command


_MORE = """Every recording is run with every scheme, setting and seed. Writes README.md
    (tables), results.json and results.jsonl. Each result is saved at once: the
    same command continues an interrupted run. The exit status is not 0 if a
    result failed or is missing.
"""

#: Commands by name, with the arguments of an example.
COMMANDS: dict[str, tuple[Callable[..., None], str]] = {
    "uzh": (
        _data_set_command("uzh", "Run the UZH event camera data set and compare with published figures"),
        "recordings/uzh --sequences boxes_6dof,poster_6dof --schemes gpif,gpp",
    ),
    "tum-vie": (
        _data_set_command("tum-vie", "Run TUM-VIE and compare with published figures"),
        "recordings/tum-vie --jobs 2",
    ),
    "vector": (
        _data_set_command("vector", "Run VECtor and compare with published figures"),
        "recordings/vector --sequences desk_normal",
    ),
    "mvsec": (
        _data_set_command("mvsec", "Run MVSEC (indoor flying) and compare with published figures"),
        "recordings/mvsec",
    ),
    "dsec": (
        _data_set_command(
            "dsec", "Run DSEC, with IMU and ground truth from elsewhere, and compare with published figures"
        ),
        "recordings/dsec",
    ),
    "evslam": (
        _data_set_command("evslam", "Run the EvSLAM benchmark by its protocol"),
        "recordings/EvSLAM --cluster tcp://192.168.0.10:8786",
    ),
    "simulated": (
        _simulated_command("simulated", "Run simulated sequences, which need no data set"),
        "--sequences moderate,aggressive --seconds 10 --seeds 3 --set window.length_s=1,2",
    ),
}
