#!/usr/bin/env bash
# Published G-code senders, headless, at the port of the rig with the GRBL controller: each runs a job to its end, by a
# pty, by TCP, and by RFC 2217 if it can. One that opens paths only gets a path that leads to TCP. One that is told where
# its job ends runs another one on the engraver.
# Usage: tests/senders.sh TORNO. PYTHONPATH and NODE_PATH say where the senders are; one that is not there is skipped.
set -euo pipefail
torno=$(realpath "$1")
here=$(realpath "$(dirname "$0")")/senders
folder=$(mktemp -d)
rig= bridge=
cleanup() {
  [ -z "$rig" ] || kill -INT "$rig" 2>/dev/null || true
  [ -z "$bridge" ] || kill "$bridge" 2>/dev/null || true
  wait
  rm -rf "$folder"
}
trap cleanup EXIT

fail() {
  cat "$folder/said" "$folder/log"
  echo "FAILED: $*"
  exit 1
}

# By what a sender reaches the rig: `pty`, `tcp` or `rfc2217`; and the rig, its job, and where that ends.
run() {
  local way=$1 machine=${2:-lathe-grbl} job=$here/${3:-shoulder.nc} place=${4:-0.356,0.000,1.000}
  local port=$folder/pc transport=(--link "$folder/pc")
  [ "$way" = pty ] || transport=(--transport "$way://127.0.0.1:0")
  # pyserial flushes 0.25 s after it has raised DTR: the banner must not come before that at this pace, either.
  [ "$way" != rfc2217 ] || transport+=(--set grbl.boot_ms=3000)
  mkfifo "$folder/ready"
  "$torno" up "$machine" --json "${transport[@]}" --control "$folder/control" --pace 10 >"$folder/ready" 2>"$folder/log" &
  rig=$!
  local ready
  read -r ready <"$folder/ready"
  if [ "$way" != pty ]; then
    port=$(sed 's,.*"port":"\([^"/]*://[^"]*\)".*,\1,' <<<"$ready")
    if ! opens_urls; then
      socat "pty,link=$folder/pc,rawer,waitslave" "tcp:${port#socket://},nodelay" &
      bridge=$!
      port=$folder/pc
      until [ -e "$port" ]; do sleep 0.1; done
    fi
  fi
  local command=(timeout 120 "$program" "$script" "$port" "$job")
  if takes_place; then command+=("$place"); fi
  (cd "$folder" && HOME=$folder "${command[@]}") >"$folder/said" 2>&1 \
    || fail "$sender did not run the job as it should by $way on $machine"
  # The sender has told where the machine stands; this is where it does.
  "$torno" ctl --socket "$folder/control" state >"$folder/state"
  # The feed axis is at its place within a count: its loop may go to the next one and back.
  local stands=('transverse .* position_counts (449|450|451),' 'depth .* position_counts 2,')
  # Within 0.01 mm of 5 and 2 mm.
  [ "$machine" != engraver ] || stands=('engraver .* x_carriage_nm (499|500)[0-9]{4},.* y_carriage_nm (199|200)[0-9]{4},')
  for expected in "${stands[@]}"; do
    grep -Eq "^$expected" "$folder/state" || { cat "$folder/state"; fail "$sender by $way: expected '$expected'"; }
  done
  kill -INT "$rig"
  wait "$rig" || true
  [ -z "$bridge" ] || { kill "$bridge" 2>/dev/null || true; wait "$bridge" || true; }
  rig= bridge=
  rm -rf "${folder:?}"/*
  echo "passed: $sender by $way on $machine"
}

opens_urls() { grep -q serial_for_url "$script"; }
takes_place() { grep -q '^port, job, place = ' "$script"; }

for script in "$here"/by_*; do
  sender=$(basename "${script%.*}")
  sender=${sender#by_}
  case $script in
    *.py)
      needs=$(sed -n 's/^# Needs: //p' "$script")
      program=python3
      there=(python3 -c "import importlib.util as i, sys; exit(not all(map(i.find_spec, sys.argv[1:])))" "$sender")
      # shellcheck disable=SC2206
      there+=($needs)
      ;;
    *.js) program=node there=(node -e "require.resolve('$sender/package.json')") ;;
  esac
  if ! "${there[@]}" 2>/dev/null; then
    echo "skipped: $sender is not installed"
    continue
  fi
  run pty
  if takes_place; then run pty engraver engraving.nc 5.000,2.000,0.000,0.000; fi
  if opens_urls; then
    run tcp
    run rfc2217
  elif command -v socat >/dev/null; then
    run tcp
  else
    echo "skipped: $sender by TCP, as socat is not installed"
  fi
done
