#!/usr/bin/env bash
# Makes sure that a Python with PX4's reader of ULog files stands in target/pyulog, where the package index can be reached.
# Without it the test that reads our ULog files with it is counted as skipped; exit status 1 then, and one sentence on standard error.
set -euo pipefail
cd "$(dirname "$0")/.."

place=target/pyulog
version=1.2.2
stop() { echo "pyulog: $1; the test that reads ULog files with it is skipped" >&2; exit 1; }
serves() { [ -x "$place/bin/python" ] && "$place/bin/python" -c 'import pyulog' 2> /dev/null; }

serves && exit 0
[ -n "$(command -v python3)" ] || stop "python3 is missing"
mkdir -p target
rm -rf "$place"
python3 -m venv "$place" > /dev/null 2>&1 || { rm -rf "$place"; stop "python3 -m venv does not work here"; }
timeout 120 "$place/bin/python" -m pip install --quiet --disable-pip-version-check "pyulog==$version" > /dev/null 2>&1 \
  || { rm -rf "$place"; stop "it could not be installed from the package index"; }
serves || { rm -rf "$place"; stop "it was installed, but cannot be imported"; }
