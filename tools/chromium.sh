#!/usr/bin/env bash
# Makes sure that Chromium is there, where apt can bring it. Without it the tests of the web page are counted as skipped; exit status 1
# then, and one sentence on standard error.
set -euo pipefail

for program in chromium chromium-browser google-chrome; do
  [ -x "/usr/bin/$program" ] && exit 0
done
stop() { echo "chromium: $1; the tests of the web page are skipped" >&2; exit 1; }
[ -n "$(command -v apt-get)" ] || stop "Chromium is missing"
as_root=()
if [ "$(id -u)" != 0 ]; then
  [ -n "$(command -v sudo)" ] || stop "installing Chromium needs root"
  as_root=(sudo)
fi
echo "Installing Chromium ..." >&2
{ "${as_root[@]}" apt-get update -qq \
    && "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
         apt-get install -y -qq --no-install-recommends chromium fonts-dejavu-core; } > /dev/null 2>&1 \
  || stop "apt-get could not install Chromium"
