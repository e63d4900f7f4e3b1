#!/usr/bin/env bash
# Measures what a newcomer waits for: fresh clone, empty target folder, build, first flight; and names the slowest units of the build.
#   tools/cold-start.sh [--empty-cache] [REVISION ...]
# --empty-cache   cargo's package cache is empty, too (everything is downloaded again)
# REVISION        commits to measure, one after the other on the same machine; default: HEAD
# Needs an idle machine: the figure is wall-clock time. Python 3 reads cargo's table of units.
set -euo pipefail
cd "$(dirname "$0")/.."

stop() { printf 'cold-start: %s\n' "$1" >&2; exit 2; }
empty_cache=
revisions=()
for argument in "$@"; do
  case "$argument" in
    --empty-cache) empty_cache=1 ;;
    -*) stop "unknown option '$argument'; expected --empty-cache or a revision" ;;
    *) revisions+=("$argument") ;;
  esac
done
[ ${#revisions[@]} -gt 0 ] || revisions=(HEAD)

here=$PWD
scratch=$(mktemp -d "${TMPDIR:-/tmp}/rotortwin-cold-start.XXXXXX")
trap 'rm -rf "$scratch"' EXIT
[ -z "$empty_cache" ] || export CARGO_HOME="$scratch/cargo-home"
unset CARGO_TARGET_DIR

for revision in "${revisions[@]}"; do
  commit=$(git rev-parse --short --verify --quiet "$revision^{commit}") || stop "'$revision' is no commit of this repository"
  clone="$scratch/$commit"
  git clone --quiet --no-local "$here" "$clone"
  git -C "$clone" checkout --quiet "$commit"
  if [ -n "$empty_cache" ]; then rm -rf "$CARGO_HOME"; else (cd "$clone" && cargo fetch --quiet --locked); fi
  echo "== $commit: ./run --exit, $(nproc) CPUs, load $(cut -d' ' -f1 /proc/loadavg), package cache $([ -n "$empty_cache" ] && echo empty || echo kept)"
  begin=$SECONDS
  # Revisions before docs/decisions/0062 have one program.
  programs=(rotortwin)
  packages=(--package rotortwin)
  [ ! -d "$clone/services/network" ] || { programs+=(rotortwin-network); packages+=(--package rotortwin-network); }
  for program in "${programs[@]}"; do
    start=$SECONDS
    (cd "$clone" && cargo build --release --locked "${packages[@]}" --bin "$program" --timings > build.log 2>&1) || { tail -n 20 "$clone/build.log" >&2; stop "the build failed at $commit"; }
    echo "$program: $((SECONDS - start)) s, $(($(stat -c %s "$clone/target/release/$program") / 1000000)) MB"
    [ "$program" = rotortwin ] || break
    mv "$clone/target/cargo-timings" "$clone/target/timings-of-$program"
    built=$SECONDS
    (cd "$clone" && ./run --exit > run.log 2>&1) || { tail -n 20 "$clone/run.log" >&2; stop "./run --exit failed at $commit"; }
    echo "flight and table $((SECONDS - built)) s, $((SECONDS - begin)) s after the clone"
  done
  python3 - "$clone"/target/timings-of-rotortwin/cargo-timing.html <<'PYTHON'
import json, re, sys

page = open(sys.argv[1], encoding="utf-8").read()
units = json.loads(re.search(r"UNIT_DATA = (\[.*?\]);\s", page, re.S).group(1))
print(f"{len(units)} units, {sum(u['duration'] for u in units):.0f} s of compiler time; the slowest (seconds, start):")
for unit in sorted(units, key=lambda u: -u["duration"])[:25]:
    print(f"  {unit['duration']:6.1f} {unit['start']:6.0f}  {unit['name']} {unit['version']} {unit['target'].strip()}")
PYTHON
  rm -rf "$clone"
done
