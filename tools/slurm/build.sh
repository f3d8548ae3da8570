#!/usr/bin/env bash
# Builds a pyramid of many files by a Slurm job array, and its index by a last job, and waits for both:
#   tools/slurm/build.sh SRC OUT.isbs SHARES [OPTIONS OF isobrick build]...
# SRC and OUT.isbs are on a file system that all nodes see. The same command again goes on where one
# ended: files that are whole stay. Where the jobs run and what they get is up to Slurm's variables,
# such as SBATCH_PARTITION, SBATCH_TIMELIMIT, SBATCH_MEM_PER_CPU; ISOBRICK names the command.
set -euo pipefail
. "$(dirname "$(readlink -f "$0")")/shares.sh"
[ $# -ge 3 ] || fail "use it as build.sh SRC OUT.isbs SHARES [OPTIONS]"
source=$1 out=${2%/} shares=$3
shift 3
checkPrerequisites
case "$source" in
phantom:*) ;;
*)
  [ -e "$source" ] || fail "there is no '$source'"
  source=$(readlink -f "$source")
  ;;
esac
[[ "$out" == *.isbs ]] || fail "'$out' does not end with .isbs, the ending of a pyramid of many files"
mkdir -p "$out.logs"
out=$(readlink -f "$out")
array=$(submitShares isobrick-build "$out.logs" "$isobrick" build "$source" -o "$out" --part "%a/$shares" --resume "$@")
last=$(submitLast isobrick-join "$out.logs" "$array" "$isobrick" merge "$out")
echo "jobs $array (shares 1-$shares) and $last (the index); logs: $out.logs"
waitFor "$out.logs" "$array" "$last"
