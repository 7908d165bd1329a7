#!/usr/bin/env bash
# Realbeam's service beside the same written with FastAPI and numpy (benches/peer), on the same model, in one run:
#   scripts/bench_peer.sh SCAN.bin [REQUESTS]        with realbeam-server on the path
# Needs Python 3 and pip; the peer's packages go into build/peer.
set -euo pipefail
cd "$(dirname "$0")/.."
scan=$(realpath "$1") requests=${2:-60} env=build/peer threads=$(nproc)
if [ ! -x "$env/bin/uvicorn" ]; then
  python3 -m venv "$env"
  "$env/bin/python" -m pip install --quiet -r benches/peer/requirements.txt
fi
realbeam-server serve --models models --addr 127.0.0.1:8091 --workers 1 --threads "$threads" >build/peer.ours.log 2>&1 &
ours=$!
MODEL=models/hdl64e/3/model.onnx THREADS=$threads "$env/bin/uvicorn" peer:app --app-dir benches/peer --port 8092 --no-access-log >build/peer.log 2>&1 &
peer=$!
trap 'kill $ours $peer' EXIT
for port in 8091/v2/health/live 8092/docs; do
  for _ in $(seq 100); do
    "$env/bin/python" -c "import urllib.request as u; u.urlopen('http://127.0.0.1:$port')" 2>/dev/null && break
    sleep 0.2
  done
done
"$env/bin/python" benches/peer/compare.py 8091 8092 "$scan" "$requests"
