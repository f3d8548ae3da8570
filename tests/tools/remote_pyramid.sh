#!/usr/bin/env bash
# The costs of a pyramid behind HTTP: nginx in a network namespace, with 1 ms and with 50 ms of delay there and
# back (tc netem), beside the local file and the same server without delay.
#
#   remote_pyramid.sh PYRAMID.isb ISOVALUE X,Y,Z RADIUS COARSE_LEVEL
#
# Prints for each network the requests, the bytes and the time of opening, of the surface around the focus and
# of the whole surface of the coarse level, medians of $RUNS runs (default: 5), each on a file just opened; and
# whether all meshes are the local file's. Rates are not limited; $RATE (such as 200mbit) limits them.
#
# Kernels without netem get the delays from tests/support/delay_relay.py, which the first line says.
#
# Needs root, nginx (Debian: nginx-light), ip and tc (iproute2). $ISOBRICK is the command. It has no place in
# the suite, which has neither; it fails where they are missing. Exit status: 0 if all meshes are the same.
set -euo pipefail

pyramid=$(realpath "$1") isovalue=$2 focus=$3 radius=$4 level=$5
runs=${RUNS:-5}
isobrick=${ISOBRICK:-isobrick}
for tool in nginx ip tc jq; do
  command -v $tool >/dev/null || { echo "$tool is missing (apt-get install nginx-light iproute2 jq)" >&2; exit 1; }
done
work=$(mktemp -d)
space=isobrick-$$
near=ib$$a far=ib$$b  # the two ends of a cable
relay=
tidy() {
  [ -z "$relay" ] || kill "$relay" 2>/dev/null || true
  [ ! -s "$work/nginx.pid" ] || kill "$(cat "$work/nginx.pid")" 2>/dev/null || true
  ip netns delete $space 2>/dev/null || true
  ip link delete $near 2>/dev/null || true
  rm -rf "$work"
}
trap tidy EXIT

ip netns add $space
ip link add $near type veth peer name $far netns $space
ip address add 10.213.77.1/30 dev $near
ip link set $near up
ip -n $space address add 10.213.77.2/30 dev $far
ip -n $space link set $far up
ip -n $space link set lo up

here=$(cd "$(dirname "$0")" && pwd)
line=netem
tc qdisc replace dev $near root netem delay 0ms 2>/dev/null || line=relay
echo "delays by $line${RATE:+, $RATE}"
[ $line = netem ] || [ -z "${RATE:-}" ] || { echo "a rate needs netem" >&2; exit 1; }

# Sets `source`: the pyramid at the end of a line of so many milliseconds there and back.
set_line() {
  local milliseconds=$1 port
  source=http://10.213.77.2:8080/scan.isb
  if [ $line = netem ]; then
    local half=$((milliseconds * 1000 / 2))us
    tc qdisc replace dev $near root netem limit 100000 delay $half ${RATE:+rate $RATE}
    tc -n $space qdisc replace dev $far root netem limit 100000 delay $half ${RATE:+rate $RATE}
  elif [ "$milliseconds" != 0 ]; then
    [ -z "$relay" ] || kill "$relay"
    mkfifo "$work/input$milliseconds"
    "$here/../support/delay_relay.py" 10.213.77.2 8080 "$milliseconds" <"$work/input$milliseconds" >"$work/port$milliseconds" &
    relay=$!
    exec 9>"$work/input$milliseconds"
    while [ ! -s "$work/port$milliseconds" ]; do sleep 0.05; done
    read -r port <"$work/port$milliseconds"
    source=http://127.0.0.1:$port/scan.isb
  fi
}

mkdir "$work/files" "$work/logs"
ln -s "$pyramid" "$work/files/scan.isb"
cat >"$work/nginx.conf" <<CONF
worker_processes 1;
pid $work/nginx.pid;
error_log $work/logs/error;
user root;
events { worker_connections 256; }
http {
  access_log $work/logs/access;
  sendfile on;
  tcp_nodelay on;
  keepalive_requests 100000;
  server { listen 10.213.77.2:8080; root $work/files; }
}
CONF
ip netns exec $space nginx -p "$work" -c "$work/nginx.conf"

# One run: fields of the JSON, one a line: opening and extraction in ms, requests and bytes of both.
run_once() {
  local source=$1 mesh=$2
  shift 2
  "$isobrick" extract "$source" --iso "$isovalue" "$@" --json -o "$mesh" --force |
    jq -r '[.seconds.open*1000, .seconds.extract[0]*1000, .remote.open_requests // 0, .remote.open_bytes // 0,
            (.remote.requests // 0) - (.remote.open_requests // 0), (.remote.bytes // 0) - (.remote.open_bytes // 0),
            .triangles, .bytes_active] | @tsv'
}
median() { sort -n | sed -n "$(((runs + 1) / 2))p"; }

status=0
printf '%-8s %-22s %9s %9s %9s %9s %11s %7s\n' network query "open ms" "requests" "query ms" "requests" bytes "/active"
for network in local 0ms 1ms 50ms; do
  source=$pyramid
  [ $network = local ] || set_line "${network%ms}"
  for query in focus coarse; do
    words=(--focus "$focus" --radius "$radius")
    [ $query = focus ] || words=(--level "$level")
    : >"$work/rows"
    for _ in $(seq "$runs"); do
      run_once "$source" "$work/$network-$query.ply" "${words[@]}" >>"$work/rows"
    done
    column() { cut -f "$1" "$work/rows" | median; }
    bytes=$(column 6) active=$(column 8)
    printf '%-8s %-22s %9.1f %9d %9.1f %9d %11d %7.2f\n' $network "$query, $(column 7) tri." "$(column 1)" "$(column 3)" \
      "$(column 2)" "$(column 5)" "$bytes" "$(jq -n "$bytes / $active")"
    cmp "$work/local-$query.ply" "$work/$network-$query.ply" || status=1
  done
done
[ $status = 0 ] && echo "all meshes are those of the local file"
exit $status
