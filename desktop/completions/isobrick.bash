# bash completion for isobrick: commands, options and their choices are those of --help.
_isobrick() {
  local current=${COMP_WORDS[COMP_CWORD]} previous=${COMP_WORDS[COMP_CWORD - 1]} help words=''
  if ((COMP_CWORD == 1)); then
    words="$("$1" --help 2>/dev/null | sed -n '/^Subcommands:/,/^$/ s/^  \([a-z]*\) .*/\1/p') --help --version"
    mapfile -t COMPREPLY < <(compgen -W "$words" -- "$current"; compgen -f -- "$current")
    return
  fi
  help=$("$1" "${COMP_WORDS[1]}" --help 2>/dev/null)
  if [[ $current == -* ]]; then
    words=$(sed -n 's/^  \(-[^ {]*\).*/\1/p' <<<"$help" | tr , ' ')
  elif [[ $previous == -* ]]; then
    words=$(sed -nE "s/^  (-.,)?$previous [^ ]*\{([^}]*)\}.*/\2/p" <<<"$help" | tr , ' ')
  fi
  if [[ -n $words ]]; then
    mapfile -t COMPREPLY < <(compgen -W "$words" -- "$current")
  else
    mapfile -t COMPREPLY < <(compgen -f -- "$current")
    compopt -o filenames 2>/dev/null
  fi
}
complete -F _isobrick isobrick
