#!/usr/bin/env bash
# canvm.sh - run a command in a throw-away guest that has a real SocketCAN vcan0
#            and a real systemd as PID 1 (User Mode Linux; no KVM, no root image).
#
#   canvm.sh [-s DIR] [-c CACHE] [-m MEM] [-t SECS] [-v] [--] COMMAND [ARG...]
#
#   -s DIR    shared read-write with the guest at the same path (default: $PWD)
#   -c CACHE  kernel + tools cache        (default: ${CANVM_CACHE:-~/.cache/canvm})
#   -m MEM    guest memory                (default: 2G; taken from the host as it is used)
#   -t SECS   hard limit, exit code 124   (default: 600)
#   -v        show the guest's console on stderr (it is always shown on a crash)
#
# The guest sees the host's whole root file system: read-only, under a tmpfs
# overlay, so whatever it writes outside DIR is gone afterwards.  stdout, stderr,
# environment, working directory and exit code of COMMAND are the caller's; it
# runs as root, stdin is /dev/null.  Exit 125: the guest itself failed.
set -euo pipefail

fail() { echo "canvm: $*" >&2; exit 125; }

share=$PWD cache=${CANVM_CACHE:-${HOME:-/root}/.cache/canvm} mem=2G limit=600 verbose=0
while getopts s:c:m:t:vh o; do case $o in
  s) share=$OPTARG ;; c) cache=$OPTARG ;; m) mem=$OPTARG ;; t) limit=$OPTARG ;;
  v) verbose=1 ;; *) sed -n '2,16s/^# \{0,1\}//p' "$0"; exit 125 ;;
esac; done
shift $((OPTIND - 1))
[ $# -gt 0 ] || fail "no command"
[ "$(id -u)" = 0 ] || fail "must run as root"
[ "$(uname -m)" = x86_64 ] || fail "user-mode-linux is packaged for x86_64 only, this is $(uname -m)"
share=$(realpath -e "$share"); mkdir -p "$cache"; cache=$(realpath "$cache")
case $share in /|/proc*|/sys*|/dev*|/run|/mnt*|/usr|/etc|/lib*) fail "will not share $share" ;; esac
case $share$cache in *[[:space:]]*) fail "paths with spaces do not work: $share, $cache" ;; esac

# ---- 1. cache: UML kernel, static busybox, can-utils; nothing is installed on the host
packages="user-mode-linux busybox-static can-utils"
download() { ( cd "$1" && rm -f ./*.deb && apt-get -qq download $packages ); }   # shellcheck disable=SC2086
fetch() {
  command -v apt-get >/dev/null || fail "no apt-get here: $packages come from Debian's archive"
  local d; d=$(mktemp -d "$cache/dl.XXXX"); chmod 755 "$d"
  # a fresh machine has no package lists yet
  download "$d" 2>/dev/null || { apt-get -qq update; download "$d"; } \
    || { rm -rf "$d"; fail "could not download $packages (see above): network or package sources?"; }
  mkdir "$d/root"; local p; for p in "$d"/*.deb; do dpkg -x "$p" "$d/root"; done
  ( cd "$d" && ls ./*.deb ) > "$d/root/versions"
  rm -rf "$cache/root"; mv "$d/root" "$cache/root"; rm -rf "$d"
}
install() {
  DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends "$@"
}
exec 9> "$cache/lock"; flock 9
[ -s "$cache/root/versions" ] || fetch >&2
miss=(); [ -x /lib/systemd/systemd ] || miss+=(systemd); command -v ip >/dev/null || miss+=(iproute2)
[ ${#miss[@]} = 0 ] || install "${miss[@]}" >&2 || { apt-get -qq update && install "${miss[@]}"; } >&2 \
  || fail "could not install ${miss[*]}"
xstate=
if grep -qw amx_tile /proc/cpuinfo; then   # more registers than this kernel knows: see xstate.c
  here=$(dirname "$(realpath "$0")") xstate=$cache/xstate.so
  command -v gcc >/dev/null || install gcc libc6-dev >&2 || { apt-get -qq update && install gcc libc6-dev; } >&2 \
    || fail "could not install gcc"
  [ "$xstate" -nt "$here/xstate.c" ] || gcc -O2 -shared -fPIC -o "$xstate" "$here/xstate.c" || fail "could not build $xstate"
fi
flock -u 9; exec 9>&-
mods=$(echo "$cache"/root/usr/lib/uml/modules/*)

# The guest's memory is a file that must be executable and large: containers often have 64 MB in /dev/shm.
backing=
for d in /dev/shm /tmp "$cache"; do
  [ "$(df --output=avail -B1 "$d" | tail -1)" -gt "$(numfmt --from=iec "$mem")" ] || continue
  findmnt -no OPTIONS -T "$d" 2>/dev/null | grep -qw noexec && continue
  backing=$d; break
done
[ -n "$backing" ] || fail "no room for $mem of guest memory in /dev/shm, /tmp or $cache"

# ---- 2. per-run control directory (shared read-write with the guest)
ctl=$(mktemp -d /tmp/canvm.XXXXXX); pid=; tails=
cleanup() {
  trap '' INT TERM
  if [ -n "$pid" ]; then kill -TERM "$pid" 2>/dev/null && wait "$pid" 2>/dev/null || :; kill -KILL -- "-$pid" 2>/dev/null || :; fi
  [ -z "$tails" ] || kill $tails 2>/dev/null || :   # (timeout made the guest a process group of its own)
  rm -rf "$ctl"
}
trap cleanup EXIT; trap 'exit 130' INT; trap 'exit 143' TERM HUP
: > "$ctl/out"; : > "$ctl/err"; : > "$ctl/console"
{ export -p; printf 'cd %q\nPATH=$PATH:%q\nunset NOTIFY_SOCKET TMPDIR\nexec' "$PWD" "$cache/root/usr/bin"; printf ' %q' "$@"; echo; } > "$ctl/cmd"

cat > "$ctl/canvm.service" <<E
[Unit]
Description=canvm command
DefaultDependencies=no
Requires=sysinit.target
Wants=dbus.socket
After=sysinit.target dbus.socket
SuccessAction=poweroff-force
FailureAction=poweroff-force
[Service]
Type=oneshot
ExecStart=/bin/bash $ctl/cmd
ExecStopPost=/bin/sh -c 'echo \$EXIT_CODE \$EXIT_STATUS > $ctl/rc; sync'
StandardOutput=append:$ctl/out
StandardError=append:$ctl/err
LimitRTPRIO=infinity
LimitMEMLOCK=infinity
E

cat > "$ctl/init" <<E
#!$cache/root/bin/busybox sh
# PID 1, stage 1: / is the host's root over hostfs, read-only
b=$cache/root/bin/busybox M=$mods R=/mnt/r C=$ctl
\$b mount -t proc proc /proc
for m in fs/overlayfs/overlay net/can/can net/can/can-raw net/can/can-bcm net/can/can-gw \\
         drivers/net/can/dev/can-dev; do \$b insmod \$M/kernel/\$m.ko || echo "canvm: insmod \$m failed"; done
# echo=1: like a controller, and unlike vcan by default, hand a frame back when it leaves the queue, not before
\$b insmod \$M/kernel/drivers/net/can/vcan.ko echo=1
\$b mount -t tmpfs -o size=75% tmpfs /mnt && \$b mkdir /mnt/u /mnt/w \$R
\$b mount -t overlay -o lowerdir=/,upperdir=/mnt/u,workdir=/mnt/w overlay \$R || exit 1
for d in \$C $share; do \$b mkdir -p \$R\$d; \$b mount -t hostfs -o \$d none \$R\$d || exit 1; done
k=\$(\$b uname -r); \$b mkdir -p \$R/lib/modules/\$k; \$b mount --bind \$M \$R/lib/modules/\$k
[ -e \$R/sbin/modprobe ] || \$b ln -s \$b \$R/sbin/modprobe
echo > \$R/etc/fstab
S=\$R/etc/systemd/system; \$b rm -rf \$S/*.wants; \$b cp \$C/canvm.service \$S/
# never run the boot-time cleaners (tmpfiles "D /tmp") and nothing that costs time
for u in systemd-tmpfiles-setup systemd-tmpfiles-setup-dev systemd-tmpfiles-clean systemd-sysusers systemd-update-utmp \\
  systemd-journal-flush systemd-random-seed systemd-boot-random-seed systemd-firstboot systemd-pstore systemd-binfmt \\
  systemd-hwdb-update systemd-remount-fs systemd-timesyncd systemd-machine-id-commit systemd-modules-load kmod-static-nodes \\
  ldconfig modprobe@configfs modprobe@dm_mod modprobe@drm modprobe@efi_pstore modprobe@fuse modprobe@loop; do
  \$b ln -sf /dev/null \$S/\$u.service; done
for u in dev-hugepages.mount sys-kernel-config.mount sys-fs-fuse-connections.mount sys-kernel-debug.mount \\
  sys-kernel-tracing.mount proc-sys-fs-binfmt_misc.automount tmp.mount; do \$b ln -sf /dev/null \$S/\$u; done
\$b mount -t sysfs sysfs /sys
ip link set lo up; ip link add dev vcan0 type vcan && ip link set vcan0 mtu 72 up || echo "canvm: no vcan0"
\$b umount /sys; \$b umount /proc
cd \$R && \$b mkdir -p .host && \$b pivot_root . .host && exec \$b chroot . /lib/systemd/systemd --unit=canvm.service </dev/console >/dev/console 2>&1
E
chmod 755 "$ctl/init"

# ---- 3. run, stream the output, return the exit code
TMPDIR=$backing timeout -k 5 "$limit" env ${xstate:+LD_PRELOAD="$xstate"} "$cache/root/usr/bin/linux.uml" mem="$mem" uml_dir="$ctl" umid=vm \
  rootfstype=hostfs rootflags=/ ro init="$ctl/init" con=null con0=fd:0,fd:1 quiet systemd.show_status=$verbose \
  </dev/null >> "$ctl/console" 2>&1 &
pid=$!
tail -qn +1 -s 0.05 -f --pid=$pid "$ctl/out" & tails=$!
tail -qn +1 -s 0.05 -f --pid=$pid "$ctl/err" >&2 & tails="$tails $!"
[ $verbose = 0 ] || { tail -qn +1 -s 0.05 -f --pid=$pid "$ctl/console" >&2 & tails="$tails $!"; }
rc=0; wait $pid || rc=$?; pid=
wait $tails || :; tails=
if [ -s "$ctl/rc" ]; then
  read -r how st < "$ctl/rc"
  if [ "$how" = exited ]; then exit "$st"; else exit $((128 + $(kill -l "$st"))); fi
fi
[ "$rc" = 124 ] || [ "$rc" = 137 ] && { echo "canvm: time limit of $limit s" >&2; exit 124; }
[ $verbose = 1 ] || tail -n 40 "$ctl/console" >&2
fail "the guest ended without a result (uml rc $rc)"
