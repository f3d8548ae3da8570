#!/bin/sh
# man_pages.sh ISOBRICK VERSION FOLDER: writes a man page for the command, and one for each subcommand, from --help.
set -eu
isobrick=$1 version=$2 folder=$3
mkdir -p "$folder"

# page NAME: of the help on stdin. Items have their text in column 39, or below if they are too long.
page() {
  sed -zE 's/\n {38}/\t/g' | awk -v name="$1" -v version="$version" '
    function roff(text) {
      gsub(/\\/, "\\\\e", text)
      gsub(/-/, "\\-", text)
      return (text ~ /^[.\047]/ ? "\\&" : "") text
    }
    function item(names,    at) {
      sub(/ *(Needs|Excludes):.*/, "", names)
      sub(/( REQUIRED)?[ \t]*$/, "", names)
      gsub(/:?\{[^}]*\}/, "", names)
      if (group == "Subcommands:") names = "isobrick-" names "(1)"
      at = match(names, / [^-]/) ? RSTART : length(names) + 1
      print ".TP\n\\fB" roff(substr(names, 1, at - 1)) "\\fR\\fI" roff(substr(names, at)) "\\fR"
    }
    NR == 1 {
      sub(/\.$/, "")
      print ".TH " roff(name) " 1 \"\" \"isobrick " version "\" \"isobrick\"\n.SH NAME\n" roff(name) " \\- " roff($0)
    }
    NR == 2 { print ".SH SYNOPSIS\n" roff(substr($0, length("Usage: ") + 1)) "\n.SH OPTIONS" }
    NR < 3 { next }
    !in_notes && (/^Examples?:$/ || /^[^ ].*[^:]$/) { print ".SH NOTES\n.nf"; in_notes = 1 }
    in_notes { print roff($0); next }
    /^[^ ]/ { group = $0; print ".SS \"" roff($0) "\""; next }
    /^  / {
      at = index($0, "\t") ? index($0, "\t") : 38
      item(substr($0, 3, at - 2))
      print roff(substr($0, at + 1))
    }
    END { print (in_notes ? ".fi\n" : "") ".SH SEE ALSO\n.BR isobrick (1)" }' >"$folder/$1.1"
}

help=$("$isobrick" --help)
printf "%s\n" "$help" | page isobrick
for command in $(printf "%s\n" "$help" | sed -n '/^Subcommands:/,/^$/ s/^  \([a-z]*\) .*/\1/p'); do
  help=$("$isobrick" "$command" --help)
  printf "%s\n" "$help" | page "isobrick-$command"
done
