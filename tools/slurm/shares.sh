# Functions of build.sh and extract.sh: shares of a work as a job array, and a last job for all of them.

fail() {
  echo "${0##*/}: $1" >&2
  exit 1
}

# The checks of both before anything is submitted.
checkPrerequisites() {
  local program
  for program in sbatch squeue scancel; do
    command -v "$program" >/dev/null || fail "cannot find '$program'; run this where Slurm's commands are"
  done
  isobrick=${ISOBRICK:-isobrick}
  command -v "$isobrick" >/dev/null || fail "cannot find '$isobrick'; put it on the path, or name it by ISOBRICK"
  isobrick=$(command -v "$isobrick")
  sinfo --noheader --states=idle,mixed,allocated --format=%n 2>/dev/null | grep -q . ||
    fail "Slurm has no node that works; see sinfo"
  [[ "$shares" =~ ^[1-9][0-9]*$ ]] || fail "the number of shares, '$shares', is not a number above 0"
}

# submitShares NAME LOGS COMMAND...: the array; %a in the words of the command is the number of the share. A process
# that a signal ends (too little memory for one) is started again, twice.
submitShares() {
  local name=$1 logs=$2
  shift 2
  local words
  words=$(printf '%q ' "$@")
  words=${words//%a/\$SLURM_ARRAY_TASK_ID}
  sbatch --parsable --job-name="$name" --array="1-$shares" --output="$logs/share-%a.log" --open-mode=truncate <<END
#!/bin/bash
for try in 1 2 3; do
  $words --threads "\${SLURM_CPUS_PER_TASK:-1}"
  status=\$?
  [ \$status -ge 128 ] || break
  echo "ended by a signal (status \$status)"
done
[ \$status -eq 0 ] && echo "share \$SLURM_ARRAY_TASK_ID is done"
exit \$status
END
}

# submitLast NAME LOGS AFTER COMMAND...: a job for when all shares have ended, well or not.
submitLast() {
  local name=$1 logs=$2 after=$3
  shift 3
  local words
  words=$(printf '%q ' "$@")
  sbatch --parsable --job-name="$name" --dependency="afterany:$after" --output="$logs/last.log" \
    --open-mode=truncate <<END
#!/bin/bash
$words --threads "\${SLURM_CPUS_PER_TASK:-1}" && echo "all is done"
END
}

# waitFor LOGS ARRAY LAST: until both have ended; Ctrl-C takes them back. Says what failed.
waitFor() {
  local logs=$1 array=$2 last=$3
  trap 'scancel "$array" "$last"; fail "interrupted; the same command goes on"' INT TERM
  while squeue --noheader --jobs="$array,$last" 2>/dev/null | grep -q .; do sleep "${ISOBRICK_SLURM_POLL:-5}"; done
  trap - INT TERM
  local failed=() share
  for ((share = 1; share <= shares; ++share)); do
    grep -qs "^share $share is done$" "$logs/share-$share.log" || failed+=("$share")
  done
  if [ ${#failed[@]} -gt 0 ]; then
    for share in "${failed[@]}"; do
      echo "share $share of $shares failed: $(tail -n 1 "$logs/share-$share.log" 2>/dev/null || echo 'it never began')" >&2
    done
    fail "${#failed[@]} of $shares shares failed (logs: $logs); the same command goes on"
  fi
  grep -qs '^all is done$' "$logs/last.log" || fail "$(tail -n 1 "$logs/last.log"); log: $logs/last.log"
  grep -v '^all is done$' "$logs/last.log" || true
}
