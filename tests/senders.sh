#!/usr/bin/env bash
# Published G-code senders, headless, at the port of the rig with the GRBL controller: each runs a job to its end.
# Usage: tests/senders.sh TORNO. PYTHONPATH says where the senders are; one that is not there is skipped.
set -euo pipefail
torno=$(realpath "$1")
here=$(realpath "$(dirname "$0")")/senders
folder=$(mktemp -d)
rig=
cleanup() {
  [ -z "$rig" ] || kill -INT "$rig" 2>/dev/null || true
  wait
  rm -rf "$folder"
}
trap cleanup EXIT

for sender in grbl_streamer grbl_link; do
  if ! python3 -c "import $sender" 2>/dev/null; then
    echo "skipped: $sender is not installed"
    continue
  fi
  mkfifo "$folder/ready"
  "$torno" up lathe-grbl --json --link "$folder/pc" --pace 10 >"$folder/ready" 2>"$folder/log" &
  rig=$!
  read -r _ <"$folder/ready"
  if ! (cd "$folder" && timeout 120 python3 "$here/by_$sender.py" "$folder/pc" "$here/shoulder.nc") >"$folder/said" 2>&1; then
    cat "$folder/said" "$folder/log"
    echo "FAILED: $sender"
    exit 1
  fi
  grep -q 'transverse: done' "$folder/log" || { echo "FAILED: $sender moved nothing"; exit 1; }
  kill -INT "$rig"
  wait "$rig" || true
  rig=
  rm -f "$folder/ready" "$folder/log"
  echo "passed: $sender"
done
