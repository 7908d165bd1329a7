#!/usr/bin/env bash
# Makes the Python environment that checks exported files with onnx.checker, and the service with tritonclient:
#   scripts/python-env.sh DIR
# Quick when it is there already. Without Python 3 or pip it says so and succeeds: outside CI those tests are then skipped, in CI they
# fail.
set -euo pipefail
dir=$1
wanted="onnx==1.23.2 tritonclient[http,grpc]==2.73.0"
if [ "$(cat "$dir/wanted" 2>/dev/null)" = "$wanted" ]; then exit 0; fi
if ! python3 -m venv "$dir" 2>/dev/null || ! "$dir/bin/python" -m pip install --quiet $wanted; then
  echo "scripts/python-env.sh: no Python environment with $wanted; the tests that need it will be skipped" >&2
  exit 0
fi
echo "$wanted" > "$dir/wanted"
