#!/usr/bin/env bash
# Published G-code senders, headless, at the port of the rig with the GRBL controller: each runs a job to its end.
# Usage: tests/senders.sh TORNO. PYTHONPATH and NODE_PATH say where the senders are; one that is not there is skipped.
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

fail() {
  cat "$folder/said" "$folder/log"
  echo "FAILED: $*"
  exit 1
}

for script in "$here"/by_*; do
  sender=$(basename "${script%.*}")
  sender=${sender#by_}
  case $script in
    *.py) program=python3 there=(python3 -c "import importlib.util as i; exit(not i.find_spec('$sender'))") ;;
    *.js) program=node there=(node -e "require.resolve('$sender/package.json')") ;;
  esac
  if ! "${there[@]}" 2>/dev/null; then
    echo "skipped: $sender is not installed"
    continue
  fi
  mkfifo "$folder/ready"
  "$torno" up lathe-grbl --json --link "$folder/pc" --pace 10 >"$folder/ready" 2>"$folder/log" &
  rig=$!
  read -r _ <"$folder/ready"
  run=(timeout 120 "$program" "$script" "$folder/pc" "$here/shoulder.nc")
  (cd "$folder" && HOME=$folder "${run[@]}") >"$folder/said" 2>&1 || fail "$sender did not run the job as it should"
  # The sender has told where the machine stands; this is where it does.
  "$torno" ctl --socket "$folder/pc-control" state >"$folder/state"
  for place in 'transverse .* position_counts 450,' 'depth .* position_counts 2,'; do
    grep -q "^$place" "$folder/state" || { cat "$folder/state"; fail "$sender: expected '$place'"; }
  done
  kill -INT "$rig"
  wait "$rig" || true
  rig=
  rm -f "$folder/ready" "$folder/log"
  echo "passed: $sender"
done
