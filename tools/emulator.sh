#!/usr/bin/env bash
# Makes sure that QEMU's Arm emulator is there, where apt can bring it. Without it the tests with the emulated board are counted as
# skipped; exit status 1 then, and one sentence on standard error.
set -euo pipefail

[ -z "$(command -v qemu-system-arm)" ] || exit 0
stop() { echo "emulator: $1" >&2; exit 1; }
[ -n "$(command -v apt-get)" ] || stop "qemu-system-arm is missing; the tests with the emulated board are skipped"
as_root=()
if [ "$(id -u)" != 0 ]; then
  [ -n "$(command -v sudo)" ] || stop "installing qemu-system-arm needs root; the tests with the emulated board are skipped"
  as_root=(sudo)
fi
echo "Installing qemu-system-arm ..." >&2
{ "${as_root[@]}" apt-get update -qq \
    && "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
         apt-get install -y -qq --no-install-recommends qemu-system-arm; } > /dev/null 2>&1 \
  || stop "apt-get could not install qemu-system-arm; the tests with the emulated board are skipped"
