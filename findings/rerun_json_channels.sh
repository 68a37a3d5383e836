#!/bin/sh
# Rerun 0.41.0 does not decode MCAP channels with JSON messages: their numbers cannot be plotted.
#
# MCAP's registry has the message encoding "json" with the schema encoding "jsonschema", and other
# viewers plot such channels. One would expect the same of `rerun mcap convert`. Instead a JSON
# message becomes one opaque column, McapMessage:data, without an error or a warning, while the same
# number in a protobuf message becomes a field that can be plotted.
#
# Seen on 2026-11-30 with rerun-sdk 0.41.0, mcap 1.4.0 and protobuf 6.33.0 on Python 3.11, Linux x86-64:
#   /json     columns: McapMessage:data
#   /protobuf columns: google.protobuf.DoubleValue:message
#
# Exits 0 if that is still so, 1 if it has changed. Installs into a temporary folder only.
set -eu
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet rerun-sdk==0.41.0 mcap==1.4.0 protobuf==6.33.0

cat > "$work/write.py" <<'PYTHON'
import json
import sys

from google.protobuf import descriptor_pb2, wrappers_pb2
from mcap.writer import Writer

with open(sys.argv[1], "wb") as file:
    writer = Writer(file)
    writer.start(profile="", library="")
    text = {"type": "object", "properties": {"value": {"type": "number"}}}
    schema = writer.register_schema("Value", "jsonschema", json.dumps(text).encode())
    plain = writer.register_channel("/json", "json", schema)
    described = descriptor_pb2.FileDescriptorSet()
    wrappers_pb2.DESCRIPTOR.CopyToProto(described.file.add())
    name = wrappers_pb2.DoubleValue.DESCRIPTOR.full_name
    schema = writer.register_schema(name, "protobuf", described.SerializeToString())
    binary = writer.register_channel("/protobuf", "protobuf", schema)
    for second in range(1, 4):
        value = 12.0 + second
        messages = {
            plain: json.dumps({"value": value}).encode(),
            binary: wrappers_pb2.DoubleValue(value=value).SerializeToString(),
        }
        for channel, data in messages.items():
            time = second * 1_000_000_000
            writer.add_message(channel, log_time=time, publish_time=time, data=data)
    writer.finish()
PYTHON

"$work/venv/bin/python" "$work/write.py" "$work/log.mcap"
"$work/venv/bin/rerun" mcap convert "$work/log.mcap" -o "$work/log.rrd" > /dev/null 2>&1
"$work/venv/bin/rerun" rrd print -v "$work/log.rrd" > "$work/chunks.txt" 2>/dev/null

columns() {
    grep " with 3 rows .* - $1 - " "$work/chunks.txt" | sed "s#.*data columns: \[##; s#\].*##; s#$1@##g"
}
json=$(columns /json)
protobuf=$(columns /protobuf)
echo "/json     columns: $json"
echo "/protobuf columns: $protobuf"
if [ "$json" = "McapMessage:data" ] && [ "$protobuf" != "McapMessage:data" ] && [ -n "$protobuf" ]; then
    echo "still so: a JSON channel is opaque, a protobuf channel is decoded"
else
    echo "changed: see above"
    exit 1
fi
