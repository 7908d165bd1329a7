#!/usr/bin/env bash
# Fetches the pinned ONNX Runtime library, checks its SHA-256 and puts it where the binaries look for it:
#   scripts/fetch-onnxruntime.sh [DIR]        DIR defaults to <cargo target directory>/release
# Prints the library's path. ORT_DYLIB_PATH, if set and there, is used as it is.
set -euo pipefail
if [ -n "${ORT_DYLIB_PATH:-}" ] && [ -f "$ORT_DYLIB_PATH" ]; then echo "$ORT_DYLIB_PATH"; exit 0; fi

version=1.31.1
wheel=onnxruntime-$version-cp312-cp312-manylinux_2_28_x86_64.whl
wheel_sha256=1f3dea47f2f0e5117c2404cea7d21fd253ae7836a3bf167a501cdfbb2600d536
archive=https://github.com/microsoft/onnxruntime/releases/download/v$version/onnxruntime-linux-x64-$version.tgz

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
dir=${1:-${CARGO_TARGET_DIR:-$root/target}/release}
mkdir -p "$dir"
library=$(cd "$dir" && pwd)/libonnxruntime.so
if [ -f "$library" ] && [ "$(cat "$library.version" 2>/dev/null)" = "$version" ]; then echo "$library"; exit 0; fi
