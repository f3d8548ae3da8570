#!/usr/bin/env bash
# Fuzzes by libFuzzer, and goes on where it stopped.
#   tests/fuzz/run.sh [GROUP|TARGET|all] [CPU_MINUTES]   default: all, 60 for each group
#   tests/fuzz/run.sh coverage [GROUP|TARGET|all]        lines and branches, by corpus/ and by all that was found
# Inputs, findings and the processor time of each target lie in ISOBRICK_FUZZ_FOLDER (~/.cache/isobrick-fuzz).
# A finding ends the run of its target, lies in findings/, and makes the status 1.
# Before: cmake --preset fuzz && cmake --build --preset fuzz -j2.
set -euo pipefail
tree=$(cd "$(dirname "$0")/../.." && pwd)
programs=${ISOBRICK_FUZZ_PROGRAMS:-$tree/build/fuzz/tests/fuzz}
folder=${ISOBRICK_FUZZ_FOLDER:-${XDG_CACHE_HOME:-$HOME/.cache}/isobrick-fuzz}
corpus=$tree/tests/fuzz/corpus
export LLVM_PROFILE_FILE=/dev/null
# Of memory that the library may ask for at once, a GiB; quarantine is the sanitizer's.
export ASAN_OPTIONS=quarantine_size_mb=16:intercept_tls_get_addr=0:detect_leaks=1
export LSAN_OPTIONS=suppressions=$tree/tests/leaks.supp:print_suppressions=0
coverage=
[ "${1:-}" != coverage ] || { coverage=1; shift; }
what=${1:-all}
minutes=${2:-60}
mkdir -p "$folder/findings"
# "GROUP TARGET SOURCES PROGRAM" of each.
all=$(for program in "$programs"/isobrick_fuzz_*; do
  if [ -x "$program" ] && [ -f "$program" ]; then ISOBRICK_FUZZ=list "$program" | sed "s|$| $program|"; fi
done)
rows=$(awk -v w="$what" 'w == "all" || $1 == w || $2 == w' <<<"$all")
[ -n "$rows" ] || { echo "no group and no target '$what'; there are:" >&2; cut -d' ' -f1,2 <<<"$all" >&2; exit 2; }

# measured FOLDERS...: "lines% branches%" of the sources that a target is for.
measured() {
  LLVM_PROFILE_FILE=$folder/raw ISOBRICK_FUZZ=$name "$program" -runs=0 "$@" >/dev/null 2>&1 || true
  llvm-profdata merge -o "$folder/profile" "$folder/raw"
  llvm-cov export "$program" -instr-profile="$folder/profile" -summary-only 2>/dev/null | python3 -c '
import json, re, sys
sums = {"lines": [0, 0], "branches": [0, 0]}
for file in json.load(sys.stdin)["data"][0]["files"]:
    if re.search(sys.argv[1], file["filename"]) and "/tests/" not in file["filename"]:
        for kind, sum in sums.items():
            sum[0] += file["summary"][kind]["covered"]
            sum[1] += file["summary"][kind]["count"]
print(*("%d of %d %s (%.0f %%)" % (*sum, kind, 100 * sum[0] / max(1, sum[1])) for kind, sum in sums.items()), sep=", ")
' "/$covers"
}

if [ -n "$coverage" ]; then
  while read -r group name covers program; do
    mkdir -p "$folder/corpus/$name"
    echo "$group $name before: $(measured "$corpus/$name"); after: $(measured "$corpus/$name" "$folder/corpus/$name")"
  done <<<"$rows"
  exit
fi

# The seconds that a target had so far.
spent() { cat "$folder/seconds.$1" 2>/dev/null || echo 0; }
groups=$(cut -d' ' -f1 <<<"$rows" | sort -u)
status=0
TIMEFORMAT='%U %S'
for group in $groups; do
  names=$(awk -v g="$group" '$1 == g { print $2 }' <<<"$rows")
  ended=" "
  left=$((60 * minutes))
  # A turn each until the time is over.
  while [ "$left" -gt 0 ] && [ "$(wc -w <<<"$ended")" -lt "$(wc -w <<<"$names")" ]; do
    for name in $names; do
      [ "$left" -gt 0 ] && [[ $ended != *" $name "* ]] || continue
      program=$(awk -v n="$name" '$2 == n { print $4 }' <<<"$rows")
      mkdir -p "$folder/corpus/$name"
      is_sound=1
      used=$({ time ISOBRICK_FUZZ=$name "$program" -max_total_time="${ISOBRICK_FUZZ_TURN:-60}" -timeout=20 -max_len=65536 \
        -rss_limit_mb=2048 -malloc_limit_mb=1024 -use_value_profile=1 -dict="$tree/tests/fuzz/words.dict" \
        -artifact_prefix="$folder/findings/$name-" "$folder/corpus/$name" "$corpus/$name" >"$folder/log.$name" 2>&1; } 2>&1) ||
        is_sound=
      used=$(awk '{ printf "%d", $1 + $2 + 0.5 }' <<<"$used")
      echo $(($(spent "$name") + used)) >"$folder/seconds.$name"
      left=$((left - used))
      [ -z "$is_sound" ] || continue
      status=1
      ended+="$name "
      echo "finding of '$name':"
      grep -E "ERROR|SUMMARY|not kept|thrown|runtime error|Test unit written" "$folder/log.$name" | head -5 || tail -n 3 "$folder/log.$name"
    done
  done
  sum=0
  for name in $names; do sum=$((sum + $(spent "$name"))); done
  awk -v g="$group" -v s=$sum 'BEGIN { printf "%s: %.1f CPU-minutes (%.2f hours) so far\n", g, s / 60, s / 3600 }'
done
exit $status
