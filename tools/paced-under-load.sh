#!/bin/sh
# A flight at the pace of the wall clock on a busy machine, without and with real-time priority: missed deadlines of 2.5 ms, and who was late and why.
#
# usage: tools/paced-under-load.sh [SECONDS [LOAD [ROUNDS]]]     (90 s = 36,000 deadlines, load 8, 1 round; ROTORTWIN names another program)
#
# LOAD processes compute without a pause beside the flight, less those that others run already. Each round flies once without and once with priority. How
# many processes were ready to run, in the mean, and how long the processors were somebody else's (steal: the host of a virtual machine) is
# printed with each flight. Last, a loop that does nothing but wake up every 2.5 ms at the highest priority: where it is late, too, nobody can be on time.
# Needs the rights of --priority (docs/hosts.md), a built target/release/rotortwin, and python3 for the loop.
set -eu
seconds=${1:-90}
load=${2:-8}
rounds=${3:-1}
for number in "$seconds" "$load" "$rounds"; do
    case $number in
        '' | *[!0-9]*) echo "paced-under-load.sh: got '$number'; expected whole numbers: SECONDS LOAD ROUNDS" >&2; exit 2 ;;
    esac
done
cd "$(dirname "$0")/.."
program=${ROTORTWIN:-target/release/rotortwin}
if [ ! -x "$program" ]; then
    echo "paced-under-load.sh: $program is not there; expected a built program (cargo build --release --locked --package rotortwin)" >&2
    exit 2
fi
scratch=$(mktemp -d)
busy=
# Only processes of this script.
end() {
    for one in $busy; do kill "$one" 2>/dev/null || true; done
    rm -rf "$scratch"
}
trap end EXIT
trap 'exit 130' INT TERM

running() { awk '/^procs_running/ { print $2 }' /proc/stat; }
steal() { awk '/^cpu / { print $9 }' /proc/stat; }

# Others' load: ready processes over three seconds, this one left out.
sum=0
for _ in 1 2 3 4 5 6; do
    sum=$((sum + $(running) - 1))
    sleep 0.5
done
others=$(((sum + 3) / 6))
more=$((load - others))
[ "$more" -ge 0 ] || more=0
echo "Machine      $(nproc) processors, $others processes of others ready to run in the mean of 3 s, $more more started here"
k=0
while [ "$k" -lt "$more" ]; do
    sh -c 'while :; do :; done' &
    busy="$busy $!"
    k=$((k + 1))
done

# fly NAME [OPTION…]
fly() {
    name=$1
    shift
    before=$(steal)
    "$program" fly hover --set duration_s="$seconds" --pace real-time --link iceoryx2 --out "$scratch/$name" "$@" >"$scratch/$name.txt" 2>&1 &
    flight=$!
    sum=0
    looks=0
    while kill -0 "$flight" 2>/dev/null; do
        sum=$((sum + $(running)))
        looks=$((looks + 1))
        sleep 1
    done
    if ! wait "$flight"; then
        cat "$scratch/$name.txt" >&2
        exit 1
    fi
    after=$(steal)
    echo
    echo "$name: $((sum / looks)) processes ready to run in the mean ($looks looks), steal $(((after - before) * 10)) ms of processor time"
    grep -E '^(Real time|Priority|Late|Run hash)' "$scratch/$name.txt"
}

round=1
while [ "$round" -le "$rounds" ]; do
    fly "without-priority-$round"
    fly "with-priority-$round" --priority
    round=$((round + 1))
done

echo
if ! command -v python3 >/dev/null; then
    echo "The empty loop is left out: python3 is not there"
    exit 0
fi
before=$(steal)
python3 - "$seconds" <<'END'
import ctypes, os, sys, time

period_s = 0.0025
if ctypes.CDLL(None).mlockall(3) != 0:
    sys.exit("paced-under-load.sh: memory cannot be locked; expected cap_ipc_lock")
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(99))
count, late_s, start_s = round(float(sys.argv[1]) / period_s), [], time.monotonic()
for step in range(1, count + 1):
    due_s = start_s + step * period_s
    time.sleep(max(0.0, due_s - time.monotonic()))
    over_s = time.monotonic() - due_s
    if over_s > period_s:
        late_s.append(over_s)
print(f"empty loop under SCHED_FIFO 99: {len(late_s)} of {count} wake-ups late by more than 2.5 ms, worst {1e3 * max(late_s, default=0.0):.1f} ms")
END
after=$(steal)
echo "steal $(((after - before) * 10)) ms of processor time"
