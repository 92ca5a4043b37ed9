#!/bin/sh
# Starts a pipeline file as a robot's boot script would, and starts it again when it fails.
#   launch/robot.sh PIPELINE.toml
# EVAC names the executable (default: evac in PATH). Logs are JSON lines on standard error.
# SIGTERM ends the pipeline: evac stops its stages in order and leaves nothing behind.
set -eu

evac=${EVAC:-evac}
pipeline=${1:?"usage: $0 PIPELINE.toml"}
pause_s=${EVAC_PAUSE_S:-5}

# A wrong configuration does not mend itself: say so once instead of restarting for ever.
"$evac" check "$pipeline"

child=
stop() {
    [ -z "$child" ] || kill -TERM "$child" 2>/dev/null || true
    [ -z "$child" ] || wait "$child" || true
    exit 0
}
trap stop INT TERM

while :; do
    "$evac" up --log-format json "$pipeline" &
    child=$!
    code=0
    wait "$child" || code=$?
    child=
    case $code in
        0) exit 0 ;;           # the walk has ended
        2|3) exit "$code" ;;   # usage or configuration
    esac
    printf '{"level":"WARN","fields":{"message":"evac ended with code %s; again in %s s"}}\n' "$code" "$pause_s" >&2
    sleep "$pause_s"
done
