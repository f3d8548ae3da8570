# For scripts that hold a process to its memory; to be sourced. Makes a folder $work (in $ISOBRICK_WORK,
# default: the system's folder for temporary files), which goes with the script, and the group that is
# in force then:
work=$(mktemp -d "${ISOBRICK_WORK:-${TMPDIR:-/tmp}}/isobrick-memory-XXXXXX")
group=""
cleanup() {
  rm -rf "$work"
  [ -z "$group" ] || rmdir "$group" 2>/dev/null || true
}
trap cleanup EXIT

# make_group LIMIT_MIB: a memory cgroup of our own, in version 1 or 2 of the interface, whose folder is
# $group; $peak_file says what it held at most, page cache included, and $held_lines which lines of its
# memory.stat are what processes hold and map. $group stays empty where none can be made.
make_group() {
  local v1=/sys/fs/cgroup/memory/isobrick-$$ v2=/sys/fs/cgroup/isobrick-$$
  group=""
  if [ -d /sys/fs/cgroup/memory ] && mkdir "$v1" 2>/dev/null; then
    group=$v1 peak_file=$v1/memory.max_usage_in_bytes held_lines="rss mapped_file"
    echo "$(($1 << 20))" >"$v1/memory.limit_in_bytes"
  elif grep -qw memory /sys/fs/cgroup/cgroup.subtree_control 2>/dev/null && mkdir "$v2" 2>/dev/null; then
    group=$v2 peak_file=$v2/memory.peak held_lines="anon file_mapped"
    echo "$(($1 << 20))" >"$v2/memory.max"
    echo 0 >"$v2/memory.swap.max" 2>/dev/null || true
  fi
}

# in_group COMMAND...: runs it in the group, if there is one. start_in_group goes on meanwhile; the
# process is $!, and Ctrl-C ends it, which jobs of a script ignore otherwise.
enter_group='[ -z "$0" ] || echo $$ >"$0/cgroup.procs"; exec "$@"'
in_group() { bash -c "$enter_group" "$group" "$@"; }
start_in_group() { env --default-signal=INT bash -c "$enter_group" "$group" "$@" & }
