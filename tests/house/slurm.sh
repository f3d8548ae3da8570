#!/usr/bin/env bash
# tools/slurm on a cluster of one node, which this test starts and ends: a pyramid and a surface by job arrays, of
# which one task is killed and one is taken back.
#   slurm.sh SOURCE_FOLDER ISOBRICK
set -euo pipefail
tools=$1/tools/slurm
export ISOBRICK=$2 ISOBRICK_SLURM_POLL=0.3
folder=$(mktemp -d)
cd "$folder"
user=$(id -un)
endAll() {
  local pid
  for pid in slurmd slurmctld munged; do
    [ ! -e "$folder/$pid.pid" ] || kill -9 "$(cat "$folder/$pid.pid")" 2>/dev/null || true
  done
  pkill -9 -f "slurmstepd.*$folder" 2>/dev/null || true
  rm -rf "$folder"
}
trap endAll EXIT
wrong() {
  echo "wrong: $1" >&2
  tail -n 20 "$folder"/*.log "$folder"/*.logs/* >&2 || true
  exit 1
}

dd if=/dev/urandom of=munge.key bs=1024 count=1 status=none
chmod 700 . munge.key
munged --key-file="$folder/munge.key" --socket="$folder/munge.socket" --pid-file="$folder/munged.pid" \
  --log-file="$folder/munged.log" --seed-file="$folder/munge.seed" --force
read -r port1 port2 < <(python3 -c 'import socket
sockets = [socket.socket() for _ in range(2)]
[s.bind(("127.0.0.1", 0)) for s in sockets]
print(*(s.getsockname()[1] for s in sockets))')
mkdir state spool
cat >slurm.conf <<END
ClusterName=isobrick
SlurmctldHost=$(hostname -s)(127.0.0.1)
SlurmUser=$user
SlurmdUser=$user
SlurmctldPort=$port1
SlurmdPort=$port2
AuthType=auth/munge
AuthInfo=socket=$folder/munge.socket
CredType=cred/munge
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.pid
SlurmctldLogFile=$folder/slurmctld.log
SlurmdLogFile=$folder/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=bf_interval=1,sched_interval=1
MinJobAge=2
KillWait=1
NodeName=$(hostname -s) NodeAddr=127.0.0.1 CPUs=2 State=UNKNOWN
PartitionName=main Nodes=ALL Default=YES MaxTime=INFINITE State=UP
END
# Neither systemd nor control groups of its own: a container or a bare root has none.
echo CgroupPlugin=cgroup/v1 >cgroup.conf
export SLURM_CONF=$folder/slurm.conf
slurmctld >>begin.log 2>&1 || wrong "slurmctld does not start"
slurmd -N "$(hostname -s)" >>begin.log 2>&1 || wrong "slurmd does not start"
for ((i = 0; i < 100; ++i)); do
  sinfo --noheader --states=idle --format=%n 2>/dev/null | grep -q . && break
  sleep 0.2
done
sinfo --noheader --states=idle --format=%n | grep -q . || wrong "the cluster does not come up"

# A share whose process is killed is made again; one that is taken back is named, and the same command goes on.
build=("$tools/build.sh" phantom:head:400 out.isbs 4 --super-brick 128)
"${build[@]}" >first.log 2>&1 &
script=$!
for ((i = 0; i < 600; ++i)); do
  if [ -e out.isbs/0-0-0.isb ] && pkill -9 -f -- "out.isbs --part 1/4"; then break; fi
  sleep 0.05
done
scancel --name=isobrick-build --state=pending
wait "$script" && wrong "a build of which shares were taken back says that all is well"
grep -q 'shares failed' first.log || wrong "$(cat first.log)"
grep -q 'lacks' out.isbs.logs/last.log || wrong "the join names nothing that is missing"
grep -q 'ended by a signal' out.isbs.logs/share-1.log || wrong "share 1 was not killed"
grep -q '^share 1 is done' out.isbs.logs/share-1.log || wrong "share 1 was not made again"
inode=$(stat -c %i out.isbs/0-0-0.isb)
"${build[@]}" >second.log 2>&1 || wrong "$(cat second.log)"
[ "$(stat -c %i out.isbs/0-0-0.isb)" = "$inode" ] || wrong "a whole file was built again"
"$ISOBRICK" verify out.isbs

"$tools/extract.sh" out.isbs 1324 mesh.ply 3 --simplify 0.3 >third.log 2>&1 || wrong "$(cat third.log)"
"$ISOBRICK" extract out.isbs --iso 1324 --simplify 0.3 -o one.ply
cmp mesh.ply one.ply || wrong "the mesh is not that of one run"
[ ! -e mesh.ply.shares ] || wrong "shares are left"

# A missing argument or file is said before anything is submitted.
for words in "nothing.nrrd x.isbs 2" "phantom:head:20 x.isb 2" "phantom:head:20 x.isbs 0"; do
  "$tools/build.sh" $words 2>bad.log && wrong "'$words' is taken"
  [ "$(wc -l <bad.log)" = 1 ] || wrong "'$words': $(cat bad.log)"
done
ISOBRICK=nothing "$tools/build.sh" phantom:head:20 x.isbs 2 2>bad.log && wrong "a command that is not there is taken"
grep -q ISOBRICK bad.log
echo "slurm: works"
