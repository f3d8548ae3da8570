#!/usr/bin/env bash
# pages.sh ISOBRICK WORK: man pages and completions are made of the commands' own definitions; they are
# free of warnings, have every option of --help, and complete.
set -euo pipefail
isobrick=$1 work=$2
rm -rf "$work"
"$isobrick" pages "$work"
fail() { echo "pages: $*" >&2; exit 1; }

checked=0
for page in "$work"/man1/*.1; do
  if command -v groff > /dev/null; then
    warnings=$(groff -man -Tutf8 -ww -z "$page" 2>&1)
    [ -z "$warnings" ] || fail "$page: $warnings"
  fi
  command=$(basename "$page" .1)
  command=${command#isobrick}
  command=${command#-}
  [ -n "$command" ] || continue
  for option in $("$isobrick" "$command" --help | grep -oE '^  (-[a-z],)?--[a-z0-9-]+' | grep -oE -- '--[a-z0-9-]+|-[a-z]\b'); do
    grep -qF -- "\\fB${option//-/\\-}\\fR" "$page" || fail "$page lacks $option"
    checked=$((checked + 1))
  done
done
[ "$checked" -gt 150 ] || fail "only $checked options were found in the help"
for command in build convert info verify extract render view phantom bench cache formats; do
  [ -s "$work/man1/isobrick-$command.1" ] || fail "there is no page of '$command'"
done

bash -n "$work/bash/isobrick"
completed() {
  bash -c 'source "$1"; shift; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _isobrick; printf "%s\n" "${COMPREPLY[@]}"' \
    bash "$work/bash/isobrick" "$@"
}
expect() {  # WORD, then what is typed
  local word=$1
  shift
  completed "$@" | grep -qxF -- "$word" || fail "'$*' does not complete to '$word'"
}
expect extract isobrick ext
expect --iso isobrick extract --is
expect --out-dir isobrick build --ou
expect --gpu-memory isobrick view --gp
expect zstd isobrick build --codec z
! completed isobrick info --is | grep -q . || fail "'info' completes an option of 'extract'"
touch "$work/a scan.isb"
(cd "$work" && expect 'a scan.isb' isobrick info a)
! command -v zsh > /dev/null || zsh -n "$work/zsh/_isobrick"
! command -v fish > /dev/null || fish -n "$work/fish/isobrick.fish"
echo "$checked options"
