#!/usr/bin/env bash
# Asks a running service everything that its description allows, and more; fails where an answer is not as the description says.
#   scripts/check_openapi.sh http://127.0.0.1:8080 [EXAMPLES]
# Needs Python 3 and pip; schemathesis goes into build/schemathesis.
set -euo pipefail
cd "$(dirname "$0")/.."
server=$1 examples=${2:-50} env=build/schemathesis
if [ ! -x "$env/bin/schemathesis" ]; then
  python3 -m venv "$env"
  "$env/bin/python" -m pip install --quiet schemathesis==4.32.5
fi
"$env/bin/schemathesis" --config-file tests/schemathesis.toml run "$server/api-doc/openapi.json" \
  --max-examples "$examples" --suppress-health-check all --seed 1
