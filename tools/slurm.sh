#!/usr/bin/env bash
# Makes sure that Slurm is there, where apt can bring it. Without it the test of campaigns on a Slurm cluster is counted as skipped; exit
# status 1 then, and one sentence on standard error.
set -euo pipefail

missing=0
for program in munged slurmctld slurmd sbatch squeue; do
  PATH="$PATH:/usr/sbin:/sbin" command -v "$program" > /dev/null || missing=1
done
[ "$missing" = 0 ] && exit 0
stop() { echo "slurm: $1; the test of campaigns on Slurm is skipped" >&2; exit 1; }
[ -n "$(command -v apt-get)" ] || stop "Slurm is missing"
as_root=()
if [ "$(id -u)" != 0 ]; then
  [ -n "$(command -v sudo)" ] || stop "installing Slurm needs root"
  as_root=(sudo)
fi
echo "Installing Slurm ..." >&2
{ "${as_root[@]}" apt-get update -qq \
    && "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive \
         apt-get install -y -qq --no-install-recommends slurm-wlm munge; } > /dev/null 2>&1 \
  || stop "apt-get could not install Slurm"
