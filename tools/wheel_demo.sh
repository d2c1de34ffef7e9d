#!/bin/sh
# Installs the wheel as a user does, outside the checkout, and runs the demonstration with it.
#
#     tools/wheel_demo.sh [PYTHON] [WHEEL]
#
# PYTHON: interpreter, 3.11 to 3.13; default: python3. WHEEL: default: one that is built from this checkout.
# SECONDS_OF_DEMO: length of the simulation; default: 6. Exit status 0 if everything is there.
set -eu

python=${1:-python3}
wheel=${2:-}
seconds=${SECONDS_OF_DEMO:-6}
checkout=$(cd "$(dirname "$0")/.." && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT INT TERM

"$python" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' || {
    echo "$("$python" --version) found; expected Python 3.11 to 3.13: name one as the first argument" >&2
    exit 1
}
echo "wheel_demo: $("$python" --version) at $python"

environment() { "$python" -m venv "$1" 2>/dev/null || "$python" -m virtualenv -q "$1"; }

if [ -z "$wheel" ]; then
    environment "$work/build"
    "$work/build/bin/python" -m pip --disable-pip-version-check -q install build
    "$work/build/bin/python" -m build --installer pip --wheel --outdir "$work/dist" "$checkout" >/dev/null
    wheel=$(ls "$work"/dist/*.whl)
fi
wheel=$(cd "$(dirname "$wheel")" && pwd)/$(basename "$wheel")
echo "wheel_demo: $(basename "$wheel"), $(wc -c <"$wheel") bytes"

# Nothing of the checkout may be found: another folder, and no PYTHONPATH.
environment "$work/venv"
cd "$work"
unset PYTHONPATH
"$work/venv/bin/python" -m pip --disable-pip-version-check -q install "$wheel[report]"
export NUMBA_CACHE_DIR="$work/numba" ASYNEIO_CACHE="$work/cache"

"$work/venv/bin/python" - "$work" <<'CHECK'
import sys
from pathlib import Path

import asyneio

found, root = Path(asyneio.__file__).resolve(), Path(sys.argv[1]).resolve()
if not found.is_relative_to(root):
    sys.exit(f"asyneio was imported from {found}; expected the installed wheel below {root}")
print(f"wheel_demo: asyneio {asyneio.__version__} from the wheel")
CHECK

"$work/venv/bin/asyneio" --version
"$work/venv/bin/asyneio" demo --duration "$seconds" -o "$work/demo" --json >"$work/demo.json"

"$work/venv/bin/python" - "$work" "$seconds" <<'CHECK'
import json
import sys
from pathlib import Path

work, seconds = Path(sys.argv[1]), float(sys.argv[2])
folder = work / "demo"
expected = ("trajectory.tum", "estimates.npz", "health.csv", "config.yaml", "report.html", "overview.png")
missing = [name for name in (*expected, "summary.json") if not (folder / name).is_file()]
if missing:
    sys.exit(f"the demonstration did not write {', '.join(missing)}; found {sorted(p.name for p in folder.iterdir())}")
summary = json.loads((folder / "summary.json").read_text())
if summary["failure"] or summary["health"] != "tracking":
    sys.exit(f"the demonstration failed: {summary['health']}, {summary['failure']}")
json.loads((work / "demo.json").read_text())
page = (folder / "report.html").read_text()
if "<svg" not in page or len(page) < 100_000:
    sys.exit(f"report.html has {len(page)} characters and no figures")
covered = summary["health_s"]["tracking"]
if covered < 0.5 * seconds:
    sys.exit(f"tracked for {covered:.1f} s of {seconds:g} s; expected at least half")
print(f"wheel_demo: {summary['knots']} knots, tracked {covered:.1f} s, compiled in {summary['timing']['compile_s']:.0f} s")
CHECK

status=0
"$work/venv/bin/asyneio" evaluate "$work/demo" "$work/demo/recording" --protocol evslam >/dev/null || status=$?
[ "$status" -eq 0 ] || { echo "evaluate exited with $status" >&2; exit 1; }
echo "wheel_demo: passed"
