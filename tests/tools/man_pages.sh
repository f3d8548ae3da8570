#!/usr/bin/env bash
# man_pages.sh ISOBRICK FOLDER: the man pages in the folder have every option of --help, and no warnings; bash completes.
set -euo pipefail
isobrick=$1 pages=$2
PATH=$(dirname "$isobrick"):$PATH
fail() { echo "man pages: $*" >&2; exit 1; }

checked=0
for page in "$pages"/*.1; do
  ! command -v groff >/dev/null || warnings=$(groff -man -Tutf8 -ww -z "$page" 2>&1)
  [ -z "${warnings:-}" ] || fail "$page: $warnings"
  command=$(basename "$page" .1 | sed -E 's/isobrick-?//')
  for option in $(isobrick $command --help | sed -nE 's/^  (-.,)?(--[a-z0-9-]+).*/\2/p'); do
    grep -A1 '^\.TP' "$page" | grep -qE -- "${option//-/\\\\-}\\\\f" || fail "$page lacks $option"
    checked=$((checked + 1))
  done
done
[ "$checked" -gt 150 ] || fail "only $checked options were found in the help"

source "$(dirname "$0")/../../desktop/completions/isobrick.bash"
compopt() { :; }
expect() {  # WORD, then what is typed
  COMP_WORDS=("${@:2}") COMP_CWORD=$(($# - 2)) COMPREPLY=()
  _isobrick isobrick
  printf '%s\n' "${COMPREPLY[@]}" | grep -qxF -- "$1" || fail "'${*:2}' does not complete to '$1'"
}
cd "$pages"
expect extract isobrick ext
expect --out-dir isobrick build --ou
expect --gpu-memory isobrick view --gp
expect zstd isobrick build --codec z
expect isobrick.1 isobrick info iso
echo "$checked options"
