#!/bin/sh
# Everything at once to a server with three workers and a Postgres of their own, for some minutes: hosts that vanish within a transaction,
# freeze for 60 s or are cut off, clocks that step by an hour, a full disk, a killed Postgres, killed servers and processes, slow clients.
# Counts what was lost, doubled or stuck, and the longest time until a lost host's job was somebody else's.
#
# usage: tools/chaos.sh [MINUTES [SEED]]     (10 minutes, seed 20)
#
# Needs Postgres's programs (tools/postgres.sh); a small disk needs root, stepping clocks a C compiler: what cannot be done is said.
set -eu
minutes=${1:-10}
case $minutes in
    '' | *[!0-9]*) echo "chaos.sh: MINUTES is '$minutes'; expected a whole number" >&2; exit 2 ;;
esac
cd "$(dirname "$0")/.."
ROTORTWIN_CHAOS_S=$((minutes * 60)) ROTORTWIN_CHAOS_SEED=${2:-20} \
    exec cargo test --release --locked --package rotortwin-tests --test server_chaos -- --nocapture
