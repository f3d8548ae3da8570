#!/usr/bin/env bash
# share_once.sh FILE COMMAND...: runs the command with -o FILE, unless the file is there. A share gets its name
# when it is whole.
file=$1
shift
if [ -e "$file" ]; then
  echo "$file: is there"
  exit 0
fi
exec "$@" -o "$file"
