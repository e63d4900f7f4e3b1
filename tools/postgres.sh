#!/usr/bin/env bash
# Makes sure that Postgres is there, where apt can bring it. Without it the tests of servers that share a database are counted as
# skipped; exit status 1 then, and one sentence on standard error.
set -euo pipefail

for programs in /usr/lib/postgresql/*/bin $(tr ':' ' ' <<< "$PATH"); do
  [ -x "$programs/initdb" ] && exit 0
done
stop() { echo "postgres: $1; the tests with Postgres are skipped" >&2; exit 1; }
[ -n "$(command -v apt-get)" ] || stop "Postgres is missing"
as_root=()
if [ "$(id -u)" != 0 ]; then
  [ -n "$(command -v sudo)" ] || stop "installing Postgres needs root"
  as_root=(sudo)
fi
echo "Installing Postgres ..." >&2
{ "${as_root[@]}" apt-get update -qq \
    && "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
         apt-get install -y -qq --no-install-recommends postgresql; } > /dev/null 2>&1 \
  || stop "apt-get could not install Postgres"
