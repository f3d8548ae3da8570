#!/usr/bin/env bash
# Extracts a surface by a Slurm job array, and merges its shares by a last job, and waits for both:
#   tools/slurm/extract.sh SCAN.isbs ISOVALUE MESH.ply SHARES [OPTIONS OF isobrick extract]...
# All is on a file system that all nodes see. The same command again goes on where one ended: shares
# that are there stay. See build.sh for what says where the jobs run.
set -euo pipefail
. "$(dirname "$(readlink -f "$0")")/shares.sh"
[ $# -ge 4 ] || fail "use it as extract.sh SCAN.isbs ISOVALUE MESH SHARES [OPTIONS]"
pyramid=$1 isovalue=$2 out=$3 shares=$4
shift 4
checkPrerequisites
[ -e "$pyramid" ] || fail "there is no '$pyramid'"
pyramid=$(readlink -f "$pyramid")
[ ! -e "$out" ] || fail "'$out' exists; move it away"
mkdir -p "$out.logs" "$out.shares"
out=$(readlink -f "$out")
# Shares of another query are not taken for those of this one.
query="$pyramid $isovalue $shares $*"
if [ -e "$out.shares/query" ] && [ "$(cat "$out.shares/query")" != "$query" ]; then
  fail "'$out.shares' has shares of another query; remove it"
fi
echo "$query" >"$out.shares/query"
array=$(submitShares isobrick-extract "$out.logs" "$(dirname "$(readlink -f "$0")")/share_once.sh" \
  "$out.shares/%a.isbm" "$isobrick" extract "$pyramid" --iso "$isovalue" --part "%a/$shares" "$@")
last=$(submitLast isobrick-merge "$out.logs" "$array" "$isobrick" merge $(
  for ((share = 1; share <= shares; ++share)); do printf '%q ' "$out.shares/$share.isbm"; done
) -o "$out")
echo "jobs $array (shares 1-$shares) and $last (the mesh); logs: $out.logs"
waitFor "$out.logs" "$array" "$last"
rm -r "$out.shares"
