#!/bin/sh
# Flies a campaign as a Slurm array: each task flies some shards of 32 flights into a folder of its own, and a job after them puts the
# shards together. A task that dies with its node is queued again by Slurm and goes on in its folder.
#
#   deploy/slurm/campaign.sh CAMPAIGN OUT [SHARDS_PER_TASK [SBATCH_OPTION...]]
#   deploy/slurm/campaign.sh wide-draw /shared/wide-draw 8 --cpus-per-task=4 --mem=2G --partition=short
#
# OUT is a folder that all nodes see; `rotortwin` is on the PATH of all nodes, in the same version. Prints the two job ids.
set -eu
stop() { printf 'campaign.sh: %s\n' "$1" >&2; exit 2; }
[ $# -ge 2 ] || stop "expected CAMPAIGN OUT [SHARDS_PER_TASK [SBATCH_OPTION...]]"
campaign=$1 out=$2 per_task=${3:-8}
[ $# -lt 3 ] && shift 2 || shift 3
[ "$per_task" -ge 1 ] 2> /dev/null || stop "SHARDS_PER_TASK: expected a whole number from 1, got '$per_task'"

plan=$(rotortwin campaign "$campaign" --check --json)
shards=$(printf '%s' "$plan" | sed -n 's/.*"shards": *\([0-9]*\).*/\1/p')
[ -n "$shards" ] || stop "rotortwin did not say how many shards $campaign has"
tasks=$(((shards + per_task - 1) / per_task))
# Slurm's default of MaxArraySize.
[ "$tasks" -le 1000 ] || stop "$tasks tasks are more than an array of 1000; give more than $per_task shards to a task"
mkdir -p "$out/parts"
out=$(cd "$out" && pwd)
case $campaign in */*) campaign=$(cd "$(dirname "$campaign")" && pwd)/$(basename "$campaign") ;; esac

array=$(sbatch --parsable --job-name="campaign" --array="0-$((tasks - 1))" --requeue --open-mode=append \
  --output="$out/parts/%a.log" "$@" << END
#!/bin/sh
set -eu
first=\$((SLURM_ARRAY_TASK_ID * $per_task))
end=\$((first + $per_task))
[ "\$end" -le $shards ] || end=$shards
exec rotortwin campaign '$campaign' --shards "\$first..\$end" --out "$out/parts/\$SLURM_ARRAY_TASK_ID" --jobs "\${SLURM_CPUS_PER_TASK:-1}"
END
)
merge=$(sbatch --parsable --job-name="campaign-merge" --dependency="afterok:$array" --kill-on-invalid-dep=yes --requeue --open-mode=append \
  --output="$out/merge.log" "$@" << END
#!/bin/sh
set -eu
exec rotortwin campaign merge '$campaign' "$out"/parts/*/ --out "$out/whole"
END
)
echo "$tasks tasks: job $array; merge: job $merge; result: $out/whole"
