#!/usr/bin/env bash
# Makes sure that a Python with Unicorn's model of a bare Cortex-M7 stands in target/processor-model, where the package index can be reached.
# Without it the test that boots the Pixhawk's program is counted as skipped; exit status 1 then, and one sentence on standard error.
set -euo pipefail
cd "$(dirname "$0")/.."

place=target/processor-model
version=2.1.4
stop() { echo "processor model: $1" >&2; exit 1; }
serves() { [ -x "$place/bin/python" ] && "$place/bin/python" -c 'import unicorn' 2> /dev/null; }

serves && exit 0
[ -n "$(command -v python3)" ] || stop "python3 is missing; the test that boots the Pixhawk's program is skipped"
mkdir -p target
rm -rf "$place"
if ! python3 -m venv "$place" > /dev/null 2>&1; then
  # Debian keeps a part of it in a package of its own.
  as_root=()
  [ "$(id -u)" = 0 ] || as_root=(sudo)
  [ -n "$(command -v apt-get)" ] && { [ "$(id -u)" = 0 ] || [ -n "$(command -v sudo)" ]; } \
    || stop "python3 -m venv does not work here; the test that boots the Pixhawk's program is skipped"
  { "${as_root[@]}" apt-get update -qq \
      && "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends python3-venv \
      && rm -rf "$place" && python3 -m venv "$place"; } > /dev/null 2>&1 \
    || stop "python3-venv could not be installed; the test that boots the Pixhawk's program is skipped"
fi
timeout 120 "$place/bin/python" -m pip install --quiet --disable-pip-version-check "unicorn==$version" > /dev/null 2>&1 \
  || stop "unicorn could not be installed from the package index; the test that boots the Pixhawk's program is skipped"
serves || stop "unicorn was installed, but cannot be imported; the test that boots the Pixhawk's program is skipped"
