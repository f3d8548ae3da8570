# Bare roots of Debian, for scripts that source this; they need root, debootstrap, and the mirror that apt is set up for.
[ "$(id -u)" -eq 0 ] || { echo "$(basename "$0"): only root may make a root folder; use sudo" >&2; exit 2; }
command -v debootstrap >/dev/null || { echo "$(basename "$0"): debootstrap is missing; apt-get install debootstrap" >&2; exit 2; }

mounts=()
mountInto() { mkdir -p "$2"; mount "${@:3}" "$1" "$2"; mounts=("$2" "${mounts[@]}"); }
unmountAll() {
  local folder
  for folder in "${mounts[@]}"; do umount -l "$folder" 2>/dev/null || true; done
  mounts=()
}
# makeRoot SUITE WORK_FOLDER ROOT: as debootstrap leaves it; what was downloaded once lies in the work folder.
makeRoot() {
  local suite=$1 work=$2 root=$3 tar=$2/$1.tar mirror
  mirror=$(apt-get indextargets --format '$(SITE)' 2>/dev/null | grep -v security | grep debian | head -n 1)
  mkdir -p "$work/archives"
  if [ ! -e "$tar" ]; then
    rm -rf --one-file-system "$work/making"
    debootstrap --variant=minbase "$suite" "$work/making" "$mirror" >"$work/debootstrap.log"
    tar -C "$work/making" -cf "$tar.part" . && mv "$tar.part" "$tar"
    rm -rf --one-file-system "$work/making"
  fi
  rm -rf --one-file-system "$root"
  mkdir -p "$root"
  tar -C "$root" -xf "$tar"
  cp /etc/resolv.conf /etc/hosts "$root/etc/"
  mountInto proc "$root/proc" -t proc
  mountInto /sys "$root/sys" --rbind
  mountInto /dev "$root/dev" --bind
  mountInto devpts "$root/dev/pts" -t devpts -o gid=5,mode=620,ptmxmode=666
  mountInto "$work/archives" "$root/var/cache/apt/archives" --bind
  inRoot "$root" root apt-get update -qq
}
# inRoot ROOT USER COMMAND...
inRoot() {
  local home=/root
  [ "$2" = root ] || home=/home/$2
  chroot --userspec="$2" "$1" env -i PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=$home \
    DEBIAN_FRONTEND=noninteractive "${@:3}"
}
