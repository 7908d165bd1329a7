#!/usr/bin/env bash
# Fetches the pinned ONNX Runtime library, checks its SHA-256 and puts it where the binaries look for it:
#   scripts/fetch-onnxruntime.sh [DIR]        DIR defaults to <cargo target directory>/release
# Prints the library's path; quick where the library is already there. ORT_DYLIB_PATH, if set and there, is used as it is.
# Source: PyPI's wheel through pip, whose bytes are pinned; without pip, the release archive, which holds another build of the
# same version: its library is taken only if its SHA-256 is the wheel's or the one in ONNXRUNTIME_SHA256.
set -euo pipefail
if [ -n "${ORT_DYLIB_PATH:-}" ] && [ -f "$ORT_DYLIB_PATH" ]; then echo "$ORT_DYLIB_PATH"; exit 0; fi

version=1.31.1
wheel=onnxruntime-$version-cp312-cp312-manylinux_2_28_x86_64.whl
wheel_sha256=1f3dea47f2f0e5117c2404cea7d21fd253ae7836a3bf167a501cdfbb2600d536
library_sha256=${ONNXRUNTIME_SHA256:-fc44112fbe06d7d689c57e11d3862031f64711007e4ee020f8eed5185fd2c1d3}
archive=https://github.com/microsoft/onnxruntime/releases/download/v$version/onnxruntime-linux-x64-$version.tgz

fail() { echo "fetch-onnxruntime: $*" >&2; exit 1; }
sha256() { sha256sum "$1" | cut -d ' ' -f 1; }

[ "$(uname -sm)" = "Linux x86_64" ] || fail "only Linux on x86_64 is pinned here; elsewhere set ORT_DYLIB_PATH to ONNX Runtime ≥ 1.24"
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
dir=${1:-${CARGO_TARGET_DIR:-$root/target}/release}
mkdir -p "$dir"
dir=$(cd "$dir" && pwd)
library=$dir/libonnxruntime.so
publish_version() { echo "$version" > "$library.version.tmp" && mv -f "$library.version.tmp" "$library.version"; }
if [ -f "$library" ] && [ "$(sha256 "$library")" = "$library_sha256" ]; then publish_version; echo "$library"; exit 0; fi

# Beside its place, so that the rename at the end is one step.
work=$(mktemp -d "$dir/.onnxruntime.XXXXXX")
trap 'rm -rf "$work"' EXIT

from_wheel() {
    python3 -m pip --version > /dev/null 2>&1 || return 1
    echo "onnxruntime==$version --hash=sha256:$wheel_sha256" > "$work/pinned.txt"
    python3 -m pip download --quiet --disable-pip-version-check --no-deps --only-binary=:all: --implementation cp \
        --python-version 3.12 --abi cp312 --platform manylinux_2_28_x86_64 --require-hashes \
        --requirement "$work/pinned.txt" --dest "$work" >&2 || return 1
    python3 - "$work/$wheel" "$version" > "$work/library" <<'PYTHON' || return 1
import sys, zipfile
sys.stdout.buffer.write(zipfile.ZipFile(sys.argv[1]).read("onnxruntime/capi/libonnxruntime.so." + sys.argv[2]))
PYTHON
}

from_archive() {
    if command -v curl > /dev/null; then curl --fail --silent --show-error --location --output "$work/archive.tgz" "$archive"
    elif command -v wget > /dev/null; then wget --quiet --output-document "$work/archive.tgz" "$archive"
    else fail "neither pip nor curl nor wget is there to fetch ONNX Runtime $version"; fi || return 1
    tar -xzOf "$work/archive.tgz" "onnxruntime-linux-x64-$version/lib/libonnxruntime.so.$version" > "$work/library"
}

if ! from_wheel; then
    echo "fetch-onnxruntime: no wheel from pip; trying $archive" >&2
    from_archive || fail "could not fetch ONNX Runtime $version, neither with pip nor from $archive; see the messages above"
fi
found=$(sha256 "$work/library")
[ "$found" = "$library_sha256" ] || fail "the library's SHA-256 is $found, expected $library_sha256; nothing was installed." \
    "If it comes from the release archive and you trust it, run again with ONNXRUNTIME_SHA256=$found"
mv -f "$work/library" "$library"
publish_version
echo "$library"
