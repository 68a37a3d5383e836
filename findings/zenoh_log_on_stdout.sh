#!/bin/sh
# Zenoh's Python library writes its log to standard output, not to standard error.
#
# A command-line program that prints its result (a table, JSON for a pipe) and switches Zenoh's log
# on to see its errors finds log lines between its own output: `program --json | jq .` fails as soon
# as Zenoh has something to say.
#
# Seen on 2026-11-30 with eclipse-zenoh 1.10.0 on Python 3.11, Linux x86-64:
#   log lines on standard output: 2, on standard error: 0
#
# Exits 0 if that is still so, 1 if it has changed. Installs into a temporary folder only; the
# session listens on loopback.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet eclipse-zenoh==1.10.0

cat > "$work/program.py" <<'PYTHON'
import zenoh

zenoh.init_log_from_env_or("info")
config = zenoh.Config()
config.insert_json5("scouting/multicast/enabled", "false")
config.insert_json5("listen/endpoints", '["tcp/127.0.0.1:0"]')
zenoh.open(config).close()
PYTHON

"$work/venv/bin/python" "$work/program.py" > "$work/out" 2> "$work/err"
out=$(grep -c INFO "$work/out" || true)
err=$(grep -c INFO "$work/err" || true)
echo "log lines on standard output: $out, on standard error: $err"
if [ "$out" -gt 0 ] && [ "$err" -eq 0 ]; then
    echo "still so: the log is on standard output"
else
    echo "changed: see above"
    exit 1
fi
